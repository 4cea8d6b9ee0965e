// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/place_run_maps.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/calibration/distortion_calibration.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/registration/confirm_alignment.h"
#include "mapper/registration/deformed_fit.h"
#include "mapper/registration/displaced_modes.h"
#include "mapper/registration/keep_alternatives.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/registration/waiting_run_maps.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/status.h"

namespace shiftmap {
namespace {

// Which modes of an aligned run map are told apart from what they are nearest to.
// @param deformed_by  The run map may be deformed as this covariance says, and the map as much.
//                     Null: the alignment is all that is uncertain.
ModeFlags ToldApart(const MapperOptions& options,
                    const Alignment& alignment,
                    const ModeMatches& matches,
                    const Eigen::MatrixXd* deformed_by) {
  const double gate = ChiSquareQuantile(options.modes.merge_probability, 2);
  const double floor = options.modes.position_floor_m;
  ModeFlags apart;
  for (const ModeIndex i : matches.indices()) {
    const ModeMatch& match = matches[i];
    double variance = alignment.PositionVariance(match.position) + 2.0 * floor * floor;
    if (deformed_by != nullptr) variance += deformed_by->block<2, 2>(2 * i, 2 * i).trace();
    apart.push_back(match.nearest.squared_m2 >= gate * variance);
  }
  return apart;
}

// What is known of the modes of a run map in the map frame.
struct Recognized {
  KnownModes known;
  ModeFlags displaced;
  std::vector<KeptAlternatives> kept;  // What is in doubt; its modes are not known.
};

// The modes that are known by what stayed, or because they were not displaced, or, of those that
// others have brought, because they are not told apart.
Recognized ByAlignment(const RunMapAlignment& aligned,
                       const std::optional<DisplacedModes>& found,
                       const ModeFlags& apart,
                       const ModeMatches& matches) {
  Recognized recognized{KnownModes(matches.size()), ModeFlags(matches.size()), {}};
  if (found) recognized.displaced = found->displaced;
  for (const ModeIndex i : matches.indices()) {
    const ModeMatch& match = matches[i];
    OptionalMode& known = recognized.known[i];
    if (aligned.stayed) {
      known = (*aligned.stayed)[i];
      recognized.displaced[i] = match.is_prior && !known;
    }
    if (!known && !(match.is_prior ? recognized.displaced[i] : apart[i])) {
      known = match.nearest.mode;
    }
  }
  return recognized;
}

// Takes out what is in doubt.
void KeepDoubts(const MapperOptions& options,
                const RunMapAlignment& aligned,
                const std::optional<DisplacedModes>& found,
                const ModeFlags& apart,
                const RunMap& run_map,
                const ModeMatches& matches,
                Recognized* recognized) {
  const auto keep = [&](const StayedPosterior& frame, double decided, const ModeFlags& told_apart) {
    std::optional<KeptAlternatives> kept =
        KeepAlternatives(frame, decided, told_apart, run_map, matches, &recognized->known);
    if (kept) recognized->kept.push_back(*std::move(kept));
  };
  keep(aligned.given, options.confirmation.min_probability, apart);
  if (!found) return;
  for (const Explanations& together : found->explanations) {
    keep(together.best().given,
         options.confirmation.min_probability_of_most,
         ModeFlags(apart.size(), true));
  }
}

// Nothing if too little of an aligned run map is known to hold it where it is.
// @param found    Of a run map on a prior map, unless `aligned` says what stayed.
// @param run_map  Moved into the map frame. Deformed onto what is known.
std::optional<Recognized> Recognize(const MapperOptions& options,
                                    const RunMapAlignment& aligned,
                                    const std::optional<DisplacedModes>& found,
                                    const BuildState& build,
                                    RunMap* run_map) {
  const ModeMatches matches = MatchNearest(run_map->build, build);
  if (aligned.deformed) {
    return Recognized{
        FitDeformedRunMap(options, build, aligned.places, run_map), ModeFlags(matches.size()), {}};
  }
  ModeFlags apart = ToldApart(options, aligned.alignment, matches, nullptr);
  Recognized recognized = ByAlignment(aligned, found, apart, matches);
  // As of places far from each other: no rigid transform puts all where the map has them.
  const bool deformed = CountKnown(recognized.known) < kMinTyingModes;
  if (deformed) {
    apart = ToldApart(options, aligned.alignment, matches, &run_map->covariance);
    recognized = ByAlignment(aligned, found, apart, matches);
  }
  KeepDoubts(options, aligned, found, apart, *run_map, matches, &recognized);
  const int count = CountKnown(recognized.known);
  if (count < kMinTyingModes) return std::nullopt;
  if (deformed) DeformOntoMap(options, build, recognized.known, run_map);
  ModeFlags decided;  // With all modes of the prior at once.
  int met = 0;
  for (const ModeIndex i : matches.indices()) {
    const bool in_doubt = std::any_of(
        recognized.kept.begin(), recognized.kept.end(), [&](const KeptAlternatives& kept) {
          return IsInDoubt(kept, matches[i].group);
        });
    decided.push_back(matches[i].is_prior || in_doubt);
    if (found && in_doubt) recognized.displaced[i] = true;
    met += matches[i].nearest.mode.has_value();
  }
  // Where most landmarks stand elsewhere, one that is taken for known deforms the run to fit.
  if (2 * count < met) return recognized;
  KnownModes grown = GrowMatches(options, *run_map, build, recognized.known, decided);
  if (grown == recognized.known) return recognized;
  recognized.known = std::move(grown);
  DeformOntoMap(options, build, recognized.known, run_map);
  return recognized;
}

// Adds a run map, already moved into the map frame.
void AddRunMap(const Recognized& recognized, RunMap run_map, BuildState* build) {
  IndexedVector<GroupIndex, IndexedVector<GroupModeIndex, GroupModeIndex>> becomes;
  ModeIndex i;
  for (const GroupIndex group : run_map.build.modes.indices()) {
    auto& of_group = becomes.emplace_back();
    for (const BuildMode& mode : run_map.build.modes[group]) {
      BuildMode added{mode.p_map_landmark, kAbsent};
      if (recognized.displaced[i]) added.displaced_to = mode.p_map_landmark;
      const OptionalMode known = recognized.known[i++];
      of_group.push_back(known ? *known : AddMode(group, added, build));
    }
  }
  build->kept.insert(build->kept.end(), recognized.kept.begin(), recognized.kept.end());
  build->kept.insert(build->kept.end(), run_map.build.kept.begin(), run_map.build.kept.end());
  for (BuildRun& run : run_map.build.runs) {
    for (const VisitIndex v : run.assignment.indices()) {
      OptionalMode& assignment = run.assignment[v];
      if (assignment) assignment = becomes[run.data->visits[v].group][*assignment];
    }
    build->runs.push_back(std::move(run));
  }
}

std::string NotAligned(const RunMap& run_map, bool has_prior) {
  const std::size_t runs = run_map.build.runs.size();
  std::string reason = "no consistent alignment with the ";
  reason += has_prior ? "map" : "other runs";
  if (runs > 1) reason += fmt::format(", as {} runs that agree with each other", runs);
  return reason;
}

// Runs that are placed before they are solved together for the first time. Then again whenever they
// are twice as many: those to come are placed in a map that is right, at the cost of two solves.
constexpr std::size_t kFirstJointSolve = 4;

// Rotates a joint covariance of positions into another frame.
void Rotate(const Eigen::Matrix2d& R, Eigen::MatrixXd* cov) {
  for (Eigen::Index i = 0; i + 1 < cov->rows(); i += 2) {
    cov->middleRows<2>(i) = (R * cov->middleRows<2>(i)).eval();
  }
  for (Eigen::Index i = 0; i + 1 < cov->cols(); i += 2) {
    cov->middleCols<2>(i) = (cov->middleCols<2>(i) * R.transpose()).eval();
  }
}

// The modes that stayed.
KnownModes Stayed(const Explanation& explanation, const RunMap& run_map, const BuildState& build) {
  const FlatModes flat(build);
  KnownModes modes(run_map.points.size());
  for (const Match& match : explanation.stayed) {
    modes[match.other] = GroupModeIndex(match.reference - flat.first[match.group]);
  }
  return modes;
}

// Where a run map lies, or nothing if it does not align, or in several ways.
// @param reference     Modes of the map, those of the groups that the run map has.
// @param explanations  Of several ways.
std::optional<RunMapAlignment> Locate(const MapperOptions& options,
                                      const std::optional<MapContent>& prior,
                                      const AlignmentPoints& reference,
                                      const BuildState& build,
                                      const RunMap& run_map,
                                      std::optional<Explanations>* explanations) {
  const double area_m2 = OccupiedArea(ModePositions(build));
  std::optional<RunMapAlignment> aligned =
      AlignRunMap(reference, run_map, area_m2, options.alignment);
  if (!options.confirmation.enabled || IsDeformable(run_map, options.alignment)) return aligned;
  std::optional<Alignment> consensus;
  if (aligned) consensus = aligned->alignment;
  const ConsensusPlace place(options, reference, area_m2, run_map, consensus);
  if (!place.NeedsConfirmation()) return aligned;
  std::optional<Explanations> found = ExplainRunMap(options, prior, build, area_m2, run_map);
  if (!found) return aligned;
  const Explanation& best = found->best();
  if (!place.Decides(best)) {
    if (aligned || !best.nothing_stayed()) *explanations = std::move(found);
    return std::nullopt;
  }
  // Where that is about the place of the consensus, the latter stays as it is.
  const bool same = place.Is(best.alignment);
  if (!same) aligned.emplace().alignment = best.alignment;
  if (!same || !place.most_agree()) {
    aligned->stayed = Stayed(best, run_map, build);
    aligned->given = best.given;
  }
  return aligned;
}

// What is undecided about landmarks that may be displaced, so that the run has to wait: the frame,
// or which landmarks stayed where too few are left that did for certain.
std::optional<Explanations> Undecided(const MapperOptions& options, const DisplacedModes& found) {
  const double decided = options.confirmation.min_probability_of_most;
  for (const Explanations& together : found.explanations) {
    const Explanation& best = together.best();
    if (best.probability < decided) return together;
    const auto& stays = best.given.stays;
    const auto certain = [&](const auto& stay) { return stay.second >= decided; };
    const auto doubtful = [&](const auto& stay) { return LeavesDoubt(stay.second, decided); };
    if (std::any_of(stays.begin(), stays.end(), doubtful) &&
        std::count_if(stays.begin(), stays.end(), certain) < kMinTyingModes) {
      return BySets(best);
    }
  }
  return std::nullopt;
}

// Run maps that agree with each other, as a map of their own.
struct JointMap {
  BuildState build;
  RunMap first;  // As it was.
};

class RunMapPlacing {
 public:
  RunMapPlacing(const MapperOptions& options,
                const StepCallback& on_step,
                std::vector<RejectedRun>* rejected)
      : options_(options), on_step_(on_step), rejected_(rejected) {}

  // Places what waits and aligns, the run map first that shares most signatures with what is there.
  void PlaceWaiting(const std::optional<MapContent>& prior,
                    WaitingRunMaps* waiting,
                    BuildState* build) {
    std::size_t settled =
        kFirstJointSolve / 2;  // Runs in the map when it was last solved as a whole.
    while (true) {
      const auto next = waiting->Next();
      // One more try in the map as all its runs have it for what did not align so far.
      const bool last_try = !next && settled >= kFirstJointSolve && settled < build->runs.size();
      if (!next && (!last_try || waiting->Remaining().empty())) return;
      if (on_step_ && !on_step_(*build)) return;
      if (last_try || build->runs.size() >= 2 * settled) {
        UpdateModes(options_, build, on_step_);
        settled = std::max(kFirstJointSolve / 2, build->runs.size());
        waiting->Recount(*build);
        continue;
      }
      PlaceNext(prior, *next, waiting, build);
    }
  }

  // Joins all that waits. Each map begins with the run map of most landmarks that is left.
  // @param nothing  A build without modes.
  std::vector<JointMap> Join(const BuildState& nothing, WaitingRunMaps* waiting) {
    std::vector<JointMap> maps;
    while (const std::optional<RunMapIndex> first = waiting->Largest()) {
      JointMap map{nothing, waiting->At(*first)};
      waiting->Recount(map.build);
      const std::size_t modes = map.first.points.size();
      AddRunMap({KnownModes(modes), ModeFlags(modes), {}}, waiting->Take(*first), &map.build);
      waiting->Update(*first, map.build);
      PlaceWaiting(std::nullopt, waiting, &map.build);
      maps.push_back(std::move(map));
      if (on_step_ && !on_step_(maps.back().build)) break;
    }
    return maps;
  }

  // As one run map. Nothing, and the runs are rejected, if these do not determine it.
  std::optional<RunMap> ToRunMap(JointMap map) {
    BuildState& build = map.build;
    rejected_->insert(rejected_->end(), build.left_out.begin(), build.left_out.end());
    build.left_out.clear();
    if (build.runs.empty()) return std::nullopt;
    const MappingRun* const first = map.first.build.runs.front().data;
    if (build.runs.size() == 1 && build.runs.front().data == first) return std::move(map.first);
    UpdateModes(options_, &build);
    DropDistortions(&build);
    std::vector<std::string> names;
    for (const BuildRun& run : build.runs) names.push_back(run.data->name);
    std::optional<RunMap> run_map = MakeUndistortedRunMap(options_, std::move(build));
    if (run_map) return run_map;
    for (std::string& name : names) rejected_->push_back({std::move(name), kUndeterminedReason});
    return std::nullopt;
  }

  // Of what is left, what has several explanations waits.
  void RejectOrWait(const WaitingRunMaps& waiting, bool has_prior, BuildState* build) {
    for (const RunMapIndex i : waiting.Remaining()) {
      const RunMap& run_map = waiting.At(i);
      if (!waiting.Open(i)) {
        Reject(run_map, NotAligned(run_map, has_prior));
        continue;
      }
      WaitingRuns& runs = build->waiting.emplace_back();
      for (const BuildRun& run : run_map.build.runs) {
        runs.runs.push_back({run.data->name, run.data->sha256});
      }
      runs.explanations = *waiting.Open(i);
    }
  }

 private:
  // Places a run map that waits, if it aligns and nothing else explains it.
  void PlaceNext(const std::optional<MapContent>& prior,
                 RunMapIndex next,
                 WaitingRunMaps* waiting,
                 BuildState* build) {
    std::optional<Explanations> explanations;
    const std::optional<RunMapAlignment> aligned = Locate(options_,
                                                          prior,
                                                          waiting->Reference(next, *build),
                                                          *build,
                                                          waiting->At(next),
                                                          &explanations);
    if (!aligned) return waiting->SetAside(next, std::move(explanations));
    RunMap placed = waiting->At(next);
    const Se2& T_map_run_map = aligned->alignment.T_reference_other;
    MoveBuild(T_map_run_map, &placed.build);
    Rotate(T_map_run_map.Rotation(), &placed.covariance);
    std::optional<DisplacedModes> found;
    if (prior && !aligned->stayed && !aligned->deformed) {
      found = FindDisplacedModes(options_, prior->covariance, *build, aligned->alignment, &placed);
      explanations = Undecided(options_, *found);
      if (explanations) return waiting->SetAside(next, std::move(explanations));
    }
    waiting->Take(next);
    const std::optional<Recognized> recognized =
        Recognize(options_, *aligned, found, *build, &placed);
    if (recognized) {
      AddRunMap(*recognized, std::move(placed), build);
    } else {
      Reject(placed, kUnconstrainedReason);
    }
    waiting->Update(next, *build);
  }

  void Reject(const RunMap& run_map, const std::string& why) {
    for (const BuildRun& run : run_map.build.runs) {
      std::set<GroupIndex> seen;
      for (const MappingVisit& visit : run.data->visits) seen.insert(visit.group);
      rejected_->push_back(
          {run.data->name, fmt::format("{} ({} landmarks seen)", why, seen.size())});
    }
  }

  const MapperOptions& options_;
  const StepCallback& on_step_;
  std::vector<RejectedRun>* rejected_;
};

// Takes out the map of most runs, the first of several.
BuildState TakeLargest(std::vector<JointMap>* maps) {
  const auto largest =
      std::max_element(maps->begin(), maps->end(), [](const JointMap& a, const JointMap& b) {
        return a.build.runs.size() < b.build.runs.size();
      });
  BuildState build = std::move(largest->build);
  maps->erase(largest);
  return build;
}

}  // namespace

void PlaceRunMaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<RunMap> run_maps,
                  BuildState* build,
                  std::vector<RejectedRun>* rejected,
                  const StepCallback& on_step) {
  RunMapPlacing placing(options, on_step, rejected);
  const bool empty = FlatModes(*build).count() == 0;
  WaitingRunMaps waiting(std::move(run_maps), *build);
  if (!empty) placing.PlaceWaiting(prior, &waiting, build);
  if (empty || waiting.Remaining().size() > 1) {
    const BuildState nothing = StartBuild(build->modes.size(), build->sensor);
    std::vector<JointMap> maps = placing.Join(nothing, &waiting);
    if (empty && !maps.empty()) *build = TakeLargest(&maps);
    std::vector<RunMap> left;
    for (JointMap& map : maps) {
      std::optional<RunMap> run_map = placing.ToRunMap(std::move(map));
      if (run_map) left.push_back(*std::move(run_map));
    }
    waiting = WaitingRunMaps(std::move(left), *build);
    placing.PlaceWaiting(prior, &waiting, build);
  }
  placing.RejectOrWait(waiting, prior.has_value(), build);
}

}  // namespace shiftmap
