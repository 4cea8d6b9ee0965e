// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/place_run_maps.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/modes/mode_refinement.h"
#include "mapper/modes/unconstrained_runs.h"
#include "mapper/registration/confirm_alignment.h"
#include "mapper/registration/deformed_fit.h"
#include "mapper/registration/displaced_modes.h"
#include "mapper/registration/keep_alternatives.h"
#include "mapper/registration/mode_match.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/registration/waiting_run_maps.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/status.h"

namespace shiftmap {
namespace {

// Per mode of an aligned run map whether it is told apart from what it is nearest to.
// @param deformed  The run map may be bent as its covariance says, and the map as much; else the
//                  alignment is all that is uncertain.
std::vector<bool> ToldApart(const MapperOptions& options,
                            const RunMapAlignment& aligned,
                            const RunMap& run_map,
                            const std::vector<ModeMatch>& mode_matches,
                            bool deformed) {
  const double gate = ChiSquareQuantile(options.modes.merge_probability, 2);
  const double floor = options.modes.position_floor_m;
  const std::vector<Eigen::Vector2d> positions = ModePositions(run_map.build);
  std::vector<bool> apart;
  for (std::size_t i = 0; i < mode_matches.size(); ++i) {
    const Eigen::Index row = RowOf(i);
    const double variance = aligned.alignment.PositionVariance(positions[i]) + 2.0 * floor * floor +
                            (deformed ? run_map.covariance.block<2, 2>(row, row).trace() : 0.0);
    apart.push_back(mode_matches[i].squared_m2 >= gate * variance);
  }
  return apart;
}

// Whether fewer than kMinTyingModes of these modes are where the map has them.
bool AreTooFew(const std::vector<OptionalMode>& known) {
  return std::ssize(known) - std::count(known.begin(), known.end(), kUnassigned) < kMinTyingModes;
}

// The mode of the build that each mode of an aligned run map is, or kUnassigned.
std::vector<OptionalMode> KnownModes(const RunMapAlignment& aligned,
                                     const std::vector<ModeMatch>& mode_matches,
                                     const std::vector<bool>& displaced,
                                     const std::vector<bool>& apart,
                                     const BuildState& build) {
  std::vector<OptionalMode> modes;
  for (std::size_t i = 0; i < mode_matches.size(); ++i) {
    const ModeMatch& mode_match = mode_matches[i];
    if (aligned.stayed && (*aligned.stayed)[i]) {
      modes.push_back((*aligned.stayed)[i]);
      continue;
    }
    const bool known = MatchesPrior(build, mode_match) ? !displaced[i] : !apart[i];
    modes.push_back(known ? mode_match.nearest : kUnassigned);
  }
  return modes;
}

// Per mode whether it meets the prior map and is not among those that stayed.
std::vector<bool> Others(const std::vector<OptionalMode>& stayed,
                         const BuildState& build,
                         const std::vector<ModeMatch>& mode_matches) {
  std::vector<bool> others;
  for (std::size_t i = 0; i < mode_matches.size(); ++i) {
    others.push_back(MatchesPrior(build, mode_matches[i]) && !stayed[i]);
  }
  return others;
}

// What is in doubt of an aligned run map. Its modes are then not known.
std::vector<KeptAlternatives> KeepDoubts(const MapperOptions& options,
                                         const RunMapAlignment& aligned,
                                         const std::optional<DisplacedModes>& found,
                                         const std::vector<bool>& apart,
                                         const RunMap& run_map,
                                         const std::vector<ModeMatch>& mode_matches,
                                         const BuildState& build,
                                         std::vector<OptionalMode>* known) {
  std::vector<KeptAlternatives> doubts;
  const auto keep =
      [&](const StayedPosterior& frame, double decided, const std::vector<bool>& told_apart) {
        std::optional<KeptAlternatives> kept =
            KeepAlternatives(frame, decided, told_apart, run_map, mode_matches, build, known);
        if (kept) doubts.push_back(*std::move(kept));
      };
  keep(aligned.given, options.confirmation.min_probability, apart);
  if (!found) return doubts;
  for (const Explanations& together : found->explanations) {
    keep(together.frames.front().given,
         options.confirmation.min_probability_of_most,
         std::vector<bool>(apart.size(), true));
  }
  return doubts;
}

bool IsInDoubt(const std::vector<KeptAlternatives>& doubts, GroupIndex group) {
  return std::any_of(doubts.begin(), doubts.end(), [&](const KeptAlternatives& kept) {
    return IsInDoubt(kept, group);
  });
}

// Adds a run map, already moved into the map frame. False, and nothing is done, if too little of it
// is known to hold it there.
// @param aligned  Nothing for the first run map, which meets no other.
// @param found    Of a run map on a prior map, unless `aligned` says what stayed.
bool Absorb(const MapperOptions& options,
            const std::optional<RunMapAlignment>& aligned,
            const std::optional<DisplacedModes>& found,
            RunMap run_map,
            BuildState* build) {
  const std::vector<ModeMatch> mode_matches = MatchNearest(run_map.build, *build);
  std::vector<bool> displaced(mode_matches.size());
  if (aligned && aligned->stayed) {
    displaced = Others(*aligned->stayed, *build, mode_matches);
  } else if (found) {
    displaced = found->displaced;
  }
  std::vector<OptionalMode> known(mode_matches.size());
  if (aligned && aligned->deformed) {
    known = FitDeformedRunMap(options, *build, aligned->places, &run_map);
  } else if (aligned) {
    std::vector<bool> apart = ToldApart(options, *aligned, run_map, mode_matches, false);
    known = KnownModes(*aligned, mode_matches, displaced, apart, *build);
    // As of places far from each other: no rigid transform puts all where the map has them.
    const bool deformed = AreTooFew(known);
    if (deformed) {
      apart = ToldApart(options, *aligned, run_map, mode_matches, true);
      known = KnownModes(*aligned, mode_matches, displaced, apart, *build);
    }
    const std::vector<KeptAlternatives> doubts =
        KeepDoubts(options, *aligned, found, apart, run_map, mode_matches, *build, &known);
    if (AreTooFew(known)) return false;
    if (deformed) DeformOntoMap(options, *build, known, &run_map);
    build->kept.insert(build->kept.end(), doubts.begin(), doubts.end());
    std::vector<bool> decided;  // With all modes of the prior at once.
    for (std::size_t i = 0; i < mode_matches.size(); ++i) {
      const bool in_doubt = IsInDoubt(doubts, mode_matches[i].group);
      decided.push_back(MatchesPrior(*build, mode_matches[i]) || in_doubt);
      if (found && in_doubt) displaced[i] = true;
    }
    // Where most landmarks stand elsewhere, one that is taken for known deforms the run to fit.
    const auto met = std::count_if(mode_matches.begin(),
                                   mode_matches.end(),
                                   [](const ModeMatch& e) { return e.nearest.has_value(); });
    const auto unknown = std::count(known.begin(), known.end(), kUnassigned);
    if (2 * (std::ssize(known) - unknown) >= met) {
      std::vector<OptionalMode> grown = GrowMatches(options, run_map, *build, known, decided);
      if (grown != known) {
        known = std::move(grown);
        DeformOntoMap(options, *build, known, &run_map);
      }
    }
  }
  const std::vector<Eigen::Vector2d> positions = ModePositions(run_map.build);
  IndexedVector<GroupIndex, IndexedVector<GroupModeIndex, GroupModeIndex>> becomes(
      run_map.build.modes.size());
  for (std::size_t i = 0; i < mode_matches.size(); ++i) {
    const ModeMatch& mode_match = mode_matches[i];
    const Eigen::Vector2d& position = positions[i];
    becomes[mode_match.group].push_back(
        known[i] ? *known[i] : AddMode(mode_match.group, {position, kAbsent, displaced[i]}, build));
  }
  build->kept.insert(build->kept.end(), run_map.build.kept.begin(), run_map.build.kept.end());
  for (BuildRun& run : run_map.build.runs) {
    for (const VisitIndex v : run.assignment.indices()) {
      OptionalMode& assignment = run.assignment[v];
      if (assignment) assignment = becomes[run.data->visits[v].group][*assignment];
    }
    build->runs.push_back(std::move(run));
  }
  return true;
}

void Reject(const RunMap& run_map, const std::string& why, std::vector<RejectedRun>* rejected) {
  for (const BuildRun& run : run_map.build.runs) {
    std::set<GroupIndex> seen;
    for (const MappingVisit& visit : run.data->visits) seen.insert(visit.group);
    rejected->push_back({run.data->name, fmt::format("{} ({} landmarks seen)", why, seen.size())});
  }
}

std::string NotAligned(const RunMap& run_map) {
  const std::size_t runs = run_map.build.runs.size();
  if (runs == 1) return "no consistent alignment with the other runs";
  return fmt::format("no consistent alignment with the map, as {} runs that agree with each other",
                     runs);
}

// Runs that are placed before they are solved together for the first time. Then again whenever they
// are twice as many: those to come are placed in a map that is right, at the cost of two solves.
constexpr std::size_t kFirstJointSolve = 4;

// The area that the map takes so far. [m²]
double AreaOf(const BuildState& build) { return OccupiedArea(ModePositions(build)); }

// Rotates a joint covariance of positions into another frame.
void Rotate(const Eigen::Matrix2d& R, Eigen::MatrixXd* cov) {
  for (Eigen::Index i = 0; i + 1 < cov->rows(); i += 2) {
    cov->middleRows<2>(i) = (R * cov->middleRows<2>(i)).eval();
  }
  for (Eigen::Index i = 0; i + 1 < cov->cols(); i += 2) {
    cov->middleCols<2>(i) = (cov->middleCols<2>(i) * R.transpose()).eval();
  }
}

// Per mode of a run map the mode of its group in the map where it stayed, or kUnassigned.
std::vector<OptionalMode> Stayed(const Explanation& explanation,
                                 const RunMap& run_map,
                                 const BuildState& build) {
  const FlatModes flat(build);
  std::vector<OptionalMode> modes(run_map.points.size());
  for (const Match& match : explanation.stayed) {
    modes[static_cast<std::size_t>(match.other.value())] =
        GroupModeIndex(match.reference - flat.first[match.group]);
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
  const double area_m2 = AreaOf(build);
  std::optional<RunMapAlignment> aligned =
      AlignRunMap(reference, run_map, area_m2, options.alignment);
  if (!options.confirmation.enabled || IsDeformable(run_map)) return aligned;
  const std::optional<Alignment> consensus =
      aligned ? std::optional(aligned->alignment) : std::nullopt;
  const bool most_agree = MostAgree(options.confirmation, reference, area_m2, run_map, consensus);
  if (!NeedsConfirmation(options, reference, area_m2, run_map, consensus, most_agree))
    return aligned;
  std::optional<Explanations> found = ExplainRunMap(options, prior, build, area_m2, run_map);
  if (!found) return aligned;
  const Explanation& best = found->frames.front();
  if (!IsDecided(options.confirmation, run_map, consensus, most_agree, best)) {
    if (aligned || !best.nothing_stayed()) *explanations = std::move(found);
    return std::nullopt;
  }
  // Where that is about the place of the consensus, the latter stays as it is.
  const bool same =
      consensus && IsSamePlace(options.confirmation, run_map, best.alignment, *consensus);
  if (!same) aligned.emplace().alignment = best.alignment;
  if (!same || !most_agree) {
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
    const Explanation& best = together.frames.front();
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

// Places a run map that waits, if it aligns and nothing else explains it.
void PlaceNext(const MapperOptions& options,
               const std::optional<MapContent>& prior,
               std::size_t next,
               WaitingRunMaps* waiting,
               BuildState* build,
               std::vector<RejectedRun>* rejected) {
  std::optional<Explanations> explanations;
  const std::optional<RunMapAlignment> aligned = Locate(
      options, prior, waiting->Reference(next, *build), *build, waiting->At(next), &explanations);
  if (!aligned) {
    waiting->SetAside(next, std::move(explanations));
    return;
  }
  RunMap placed = waiting->At(next);
  const Se2& T_map_run_map = aligned->alignment.T_reference_other;
  MoveBuild(T_map_run_map, &placed.build);
  Rotate(T_map_run_map.Rotation(), &placed.covariance);
  std::optional<DisplacedModes> found;
  if (prior && !aligned->stayed && !aligned->deformed) {
    found = FindDisplacedModes(options, prior->covariance, *build, aligned->alignment, &placed);
    explanations = Undecided(options, *found);
    if (explanations) {
      waiting->SetAside(next, std::move(explanations));
      return;
    }
  }
  waiting->Take(next);
  std::vector<RejectedRun> rejection;
  Reject(placed, kUnconstrainedReason, &rejection);
  if (!Absorb(options, aligned, found, std::move(placed), build)) {
    rejected->insert(rejected->end(), rejection.begin(), rejection.end());
  }
  waiting->Update(next, *build);
}

// Places what waits and aligns, the run map first that shares most signatures with what is there.
void PlaceWaiting(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  WaitingRunMaps* waiting,
                  BuildState* build,
                  std::vector<RejectedRun>* rejected,
                  const StepCallback& on_step) {
  std::size_t settled =
      kFirstJointSolve / 2;  // Runs in the map when it was last solved as a whole.
  while (true) {
    const auto next = waiting->Next();
    // One more try in the map as all its runs have it for what did not align so far.
    const bool last_try = !next && settled >= kFirstJointSolve && settled < build->runs.size();
    if (!next && (!last_try || waiting->Remaining().empty())) return;
    if (on_step && !on_step(*build)) return;
    if (last_try || build->runs.size() >= 2 * settled) {
      UpdateModes(options, build, on_step);
      settled = std::max(kFirstJointSolve / 2, build->runs.size());
      waiting->Recount(*build);
      continue;
    }
    PlaceNext(options, prior, *next, waiting, build, rejected);
  }
}

// RunMaps that agree with each other, as a map of their own.
struct JointMap {
  BuildState build;
  RunMap first;  // As it was.
};

// Joins all that waits. Each map begins with the run map of most landmarks that is left.
// @param nothing  A build without modes.
std::vector<JointMap> Join(const MapperOptions& options,
                           const BuildState& nothing,
                           WaitingRunMaps* waiting,
                           std::vector<RejectedRun>* rejected,
                           const StepCallback& on_step) {
  std::vector<JointMap> maps;
  while (const std::optional<std::size_t> first = waiting->Largest()) {
    JointMap map{nothing, waiting->At(*first)};
    waiting->Recount(map.build);
    Absorb(options, std::nullopt, std::nullopt, waiting->Take(*first), &map.build);
    waiting->Update(*first, map.build);
    PlaceWaiting(options, std::nullopt, waiting, &map.build, rejected, on_step);
    maps.push_back(std::move(map));
    if (on_step && !on_step(maps.back().build)) break;
  }
  return maps;
}

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

// As one run map. Nothing, and the runs are rejected, if these do not determine it.
std::optional<RunMap> ToRunMap(const MapperOptions& options,
                               JointMap map,
                               std::vector<RejectedRun>* rejected) {
  BuildState& build = map.build;
  rejected->insert(rejected->end(), build.left_out.begin(), build.left_out.end());
  build.left_out.clear();
  if (build.runs.empty()) return std::nullopt;
  const MappingRun* const first = map.first.build.runs.front().data;
  if (build.runs.size() == 1 && build.runs.front().data == first) return std::move(map.first);
  UpdateModes(options, &build);
  SolveContinuous(options, &build);
  std::vector<std::string> names;
  for (const BuildRun& run : build.runs) names.push_back(run.data->name);
  std::optional<RunMap> run_map = MakeRunMap(options, std::move(build));
  if (run_map) return run_map;
  for (std::string& name : names) rejected->push_back({std::move(name), kUndeterminedReason});
  return std::nullopt;
}

}  // namespace

void PlaceRunMaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<RunMap> run_maps,
                  BuildState* build,
                  std::vector<RejectedRun>* rejected,
                  const StepCallback& on_step) {
  const bool empty = FlatModes(*build).count() == 0;
  WaitingRunMaps waiting(std::move(run_maps), *build);
  if (!empty) PlaceWaiting(options, prior, &waiting, build, rejected, on_step);
  if (empty || waiting.Remaining().size() > 1) {
    const BuildState nothing = StartBuild(build->modes.size(), build->sensor);
    std::vector<JointMap> maps = Join(options, nothing, &waiting, rejected, on_step);
    if (empty && !maps.empty()) *build = TakeLargest(&maps);
    std::vector<RunMap> left;
    for (JointMap& map : maps) {
      std::optional<RunMap> run_map = ToRunMap(options, std::move(map), rejected);
      if (run_map) left.push_back(*std::move(run_map));
    }
    waiting = WaitingRunMaps(std::move(left), *build);
    PlaceWaiting(options, prior, &waiting, build, rejected, on_step);
  }
  for (const std::size_t i : waiting.Remaining()) {
    const RunMap& run_map = waiting.At(i);
    if (!waiting.Open(i)) {
      Reject(run_map, NotAligned(run_map), rejected);
      continue;
    }
    WaitingRuns& runs = build->waiting.emplace_back();
    for (const BuildRun& run : run_map.build.runs) {
      runs.runs.push_back({run.data->name, run.data->sha256});
    }
    runs.explanations = *waiting.Open(i);
  }
}

}  // namespace shiftmap
