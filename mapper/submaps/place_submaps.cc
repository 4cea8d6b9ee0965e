// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/place_submaps.h"

#include <algorithm>
#include <set>
#include <utility>

#include "mapper/modes/loose_runs.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/submaps/confirm_alignment.h"
#include "mapper/submaps/displaced_modes.h"
#include "mapper/submaps/encounter.h"
#include "mapper/submaps/submap_alignment.h"
#include "mapper/submaps/submap_fit.h"
#include "mapper/submaps/waiting_submaps.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/status.h"

namespace shiftmap {
namespace {

// The mode of the problem that each mode of an aligned submap is, or kUnassigned.
std::vector<int> KnownModes(const MapperOptions& options,
                            const SubmapAlignment& aligned,
                            const Submap& submap,
                            const std::vector<Encounter>& encounters,
                            const std::vector<bool>& displaced,
                            const MapProblem& problem) {
  const double gate = ChiSquareQuantile(options.modes.merge_probability, 2);
  const double floor = options.modes.position_floor_m;
  const std::vector<Eigen::Vector2d> positions = ModePositions(submap.problem);
  std::vector<int> modes;
  for (std::size_t i = 0; i < encounters.size(); ++i) {
    const Encounter& encounter = encounters[i];
    const Eigen::Vector2d& position = positions[i];
    if (aligned.stayed && (*aligned.stayed)[i] != kUnassigned) {
      modes.push_back((*aligned.stayed)[i]);
      continue;
    }
    const double variance = aligned.alignment.PositionVariance(position) + 2.0 * floor * floor;
    const bool known =
        MeetsPrior(problem, encounter) ? !displaced[i] : encounter.squared_m2 < gate * variance;
    modes.push_back(known ? encounter.nearest : kUnassigned);
  }
  return modes;
}

// Per mode whether it meets the prior map and is not among those that stayed.
std::vector<bool> Others(const std::vector<int>& stayed,
                         const MapProblem& problem,
                         const std::vector<Encounter>& encounters) {
  std::vector<bool> others;
  for (std::size_t i = 0; i < encounters.size(); ++i) {
    others.push_back(MeetsPrior(problem, encounters[i]) && stayed[i] == kUnassigned);
  }
  return others;
}

// Adds a submap, already moved into the map frame. False, and nothing is done, if too little of it
// is known to hold it there.
// @param aligned  Nothing for the first submap, which meets no other.
bool Absorb(const MapperOptions& options,
            const std::optional<MapContent>& prior,
            const std::optional<SubmapAlignment>& aligned,
            Submap submap,
            MapProblem* problem) {
  std::vector<Encounter> encounters = Meet(submap.problem, *problem);
  const bool bent = aligned && aligned->bent;
  std::vector<bool> displaced(encounters.size());
  if (aligned && aligned->stayed) {
    displaced = Others(*aligned->stayed, *problem, encounters);
  } else if (prior && aligned && !bent) {
    displaced = FindDisplacedModes(
        options, prior->covariance, *problem, aligned->alignment, &submap, &encounters);
  }
  std::vector<int> known(encounters.size(), kUnassigned);
  if (bent) {
    known = FitBentSubmap(options, *problem, aligned->places, &submap);
  } else if (aligned) {
    known = KnownModes(options, *aligned, submap, encounters, displaced, *problem);
    const auto unknown = std::count(known.begin(), known.end(), kUnassigned);
    if (std::ssize(known) - unknown < kMinTyingModes) return false;
    std::vector<bool> decided;  // With all modes of the prior at once.
    for (const Encounter& encounter : encounters) {
      decided.push_back(MeetsPrior(*problem, encounter));
    }
    // Where most landmarks stand elsewhere, one that is taken for known bends the run to fit.
    const auto met = std::count_if(encounters.begin(), encounters.end(), [](const Encounter& e) {
      return e.nearest != kUnassigned;
    });
    if (2 * (std::ssize(known) - unknown) >= met) {
      std::vector<int> grown = GrowMatches(options, submap, *problem, known, decided);
      if (grown != known) {
        known = std::move(grown);
        BendOntoMap(options, *problem, known, &submap);
      }
    }
  }
  const std::vector<Eigen::Vector2d> positions = ModePositions(submap.problem);
  std::vector<std::vector<int>> becomes(submap.problem.modes.size());
  for (std::size_t i = 0; i < encounters.size(); ++i) {
    const Encounter& encounter = encounters[i];
    const Eigen::Vector2d& position = positions[i];
    becomes[static_cast<std::size_t>(encounter.group)].push_back(
        known[i] != kUnassigned
            ? known[i]
            : AddMode(encounter.group, {position, kAbsent, displaced[i]}, problem));
  }
  for (BuildRun& run : submap.problem.runs) {
    for (std::size_t v = 0; v < run.assignment.size(); ++v) {
      int& assignment = run.assignment[v];
      const auto group = static_cast<std::size_t>(run.data->visits[v].group);
      if (assignment != kUnassigned)
        assignment = becomes[group][static_cast<std::size_t>(assignment)];
    }
    problem->runs.push_back(std::move(run));
  }
  return true;
}

void Reject(const Submap& submap, const std::string& why, std::vector<RejectedRun>* rejected) {
  for (const BuildRun& run : submap.problem.runs) {
    std::set<int> seen;
    for (const MappingVisit& visit : run.data->visits) seen.insert(visit.group);
    rejected->push_back({run.data->name, fmt::format("{} ({} landmarks seen)", why, seen.size())});
  }
}

std::string NotAligned(const Submap& submap) {
  const std::size_t runs = submap.problem.runs.size();
  if (runs == 1) return "no consistent alignment with the other runs";
  return fmt::format("no consistent alignment with the map, as {} runs that agree with each other",
                     runs);
}

// Runs that are placed before they are solved together for the first time. Then again whenever they
// are twice as many: those to come are placed in a map that is right, at the cost of two solves.
constexpr std::size_t kFirstSettled = 4;

// The area that the map takes so far. [m²]
double AreaOf(const MapProblem& problem) { return OccupiedArea(ModePositions(problem)); }

// Rotates a joint covariance of positions into another frame.
void Rotate(const Eigen::Matrix2d& R, Eigen::MatrixXd* cov) {
  for (Eigen::Index i = 0; i + 1 < cov->rows(); i += 2) {
    cov->middleRows<2>(i) = (R * cov->middleRows<2>(i)).eval();
  }
  for (Eigen::Index i = 0; i + 1 < cov->cols(); i += 2) {
    cov->middleCols<2>(i) = (cov->middleCols<2>(i) * R.transpose()).eval();
  }
}

// Per mode of a submap the mode of its group in the map where it stayed, or kUnassigned.
std::vector<int> Stayed(const Explanation& explanation,
                        const Submap& submap,
                        const MapProblem& problem) {
  const FlatModes flat(problem);
  std::vector<int> modes(submap.points.size(), kUnassigned);
  for (const Match& match : explanation.stayed) {
    const auto i = static_cast<std::size_t>(match.other);
    const auto group = static_cast<std::size_t>(submap.points[i].group);
    modes[i] = match.reference - flat.first[group];
  }
  return modes;
}

// Where a submap lies, or nothing if it does not align, or in several ways.
// @param reference     Modes of the map, those of the groups that the submap has.
// @param explanations  Of several ways.
std::optional<SubmapAlignment> Locate(const MapperOptions& options,
                                      const std::optional<MapContent>& prior,
                                      const std::vector<AlignmentPoint>& reference,
                                      const MapProblem& problem,
                                      const Submap& submap,
                                      std::optional<Explanations>* explanations) {
  const double area_m2 = AreaOf(problem);
  std::optional<SubmapAlignment> aligned =
      AlignSubmap(reference, submap, area_m2, options.alignment);
  if (!options.confirmation.enabled || IsBent(submap)) return aligned;
  const std::optional<Alignment> consensus =
      aligned ? std::optional(aligned->alignment) : std::nullopt;
  if (!NeedsConfirmation(options, reference, area_m2, submap, consensus)) return aligned;
  std::optional<Explanations> found = ExplainSubmap(options, prior, problem, area_m2, submap);
  if (!found) return aligned;
  const Explanation& best = found->frames.front();
  if (!IsDecided(options.confirmation, reference, area_m2, submap, consensus, best)) {
    if (aligned || !best.nothing_stayed()) *explanations = std::move(found);
    return std::nullopt;
  }
  // Where that is about the place of the consensus, the latter stays as it is.
  const bool same =
      consensus && IsSamePlace(options.confirmation, submap, best.alignment, *consensus);
  if (!same) aligned.emplace().alignment = best.alignment;
  if (!same || FewAgree(options.confirmation, reference, area_m2, submap, *consensus)) {
    aligned->stayed = Stayed(best, submap, problem);
  }
  return aligned;
}

// Places a submap that waits, if it aligns and nothing else explains it.
void PlaceNext(const MapperOptions& options,
               const std::optional<MapContent>& prior,
               std::size_t next,
               WaitingSubmaps* waiting,
               MapProblem* problem,
               std::vector<RejectedRun>* rejected) {
  std::optional<Explanations> explanations;
  const std::optional<SubmapAlignment> aligned = Locate(options,
                                                        prior,
                                                        waiting->Reference(next, *problem),
                                                        *problem,
                                                        waiting->At(next),
                                                        &explanations);
  if (!aligned) {
    waiting->SetAside(next, std::move(explanations));
    return;
  }
  Submap placed = waiting->Take(next);
  const Se2& T_map_submap = aligned->alignment.T_reference_other;
  MoveProblem(T_map_submap, &placed.problem);
  Rotate(T_map_submap.Rotation(), &placed.covariance);
  std::vector<RejectedRun> rejection;
  Reject(placed, kLooseReason, &rejection);
  if (!Absorb(options, prior, aligned, std::move(placed), problem)) {
    rejected->insert(rejected->end(), rejection.begin(), rejection.end());
  }
  waiting->Update(next, *problem);
}

// Places what waits and aligns, the submap first that shares most signatures with what is there.
void PlaceWaiting(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  WaitingSubmaps* waiting,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected,
                  const GoOn& go_on) {
  std::size_t settled = kFirstSettled / 2;  // Runs in the map when it was last solved as a whole.
  while (true) {
    const auto next = waiting->Next();
    // One more try in the map as all its runs have it for what did not align so far.
    const bool last_try = !next && settled >= kFirstSettled && settled < problem->runs.size();
    if (!next && (!last_try || waiting->Remaining().empty())) return;
    if (go_on && !go_on(*problem)) return;
    if (last_try || problem->runs.size() >= 2 * settled) {
      SettleModes(options, problem, go_on);
      settled = std::max(kFirstSettled / 2, problem->runs.size());
      waiting->Recount(*problem);
      continue;
    }
    PlaceNext(options, prior, *next, waiting, problem, rejected);
  }
}

// Submaps that agree with each other, as a map of their own.
struct JointMap {
  MapProblem problem;
  Submap first;  // As it was.
};

// Joins all that waits. Each map begins with the submap of most landmarks that is left.
// @param nothing  A problem without modes.
std::vector<JointMap> Join(const MapperOptions& options,
                           const MapProblem& nothing,
                           WaitingSubmaps* waiting,
                           std::vector<RejectedRun>* rejected,
                           const GoOn& go_on) {
  std::vector<JointMap> maps;
  while (const std::optional<std::size_t> first = waiting->Largest()) {
    JointMap map{nothing, waiting->At(*first)};
    waiting->Recount(map.problem);
    Absorb(options, std::nullopt, std::nullopt, waiting->Take(*first), &map.problem);
    waiting->Update(*first, map.problem);
    PlaceWaiting(options, std::nullopt, waiting, &map.problem, rejected, go_on);
    maps.push_back(std::move(map));
    if (go_on && !go_on(maps.back().problem)) break;
  }
  return maps;
}

// Takes out the map of most runs, the first of several.
MapProblem TakeLargest(std::vector<JointMap>* maps) {
  const auto largest =
      std::max_element(maps->begin(), maps->end(), [](const JointMap& a, const JointMap& b) {
        return a.problem.runs.size() < b.problem.runs.size();
      });
  MapProblem problem = std::move(largest->problem);
  maps->erase(largest);
  return problem;
}

// As one submap. Nothing, and the runs are rejected, if these do not determine it.
std::optional<Submap> ToSubmap(const MapperOptions& options,
                               JointMap map,
                               std::vector<RejectedRun>* rejected) {
  MapProblem& problem = map.problem;
  rejected->insert(rejected->end(), problem.left_out.begin(), problem.left_out.end());
  problem.left_out.clear();
  if (problem.runs.empty()) return std::nullopt;
  const MappingRun* const first = map.first.problem.runs.front().data;
  if (problem.runs.size() == 1 && problem.runs.front().data == first) return std::move(map.first);
  SettleModes(options, &problem);
  SolveContinuous(options, &problem);
  std::vector<std::string> names;
  for (const BuildRun& run : problem.runs) names.push_back(run.data->name);
  std::optional<Submap> submap = MakeSubmap(options, std::move(problem));
  if (submap) return submap;
  for (std::string& name : names) rejected->push_back({std::move(name), kUndeterminedReason});
  return std::nullopt;
}

}  // namespace

void PlaceSubmaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<Submap> submaps,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected,
                  const GoOn& go_on) {
  const bool empty = FlatModes(*problem).count == 0;
  WaitingSubmaps waiting(std::move(submaps), *problem);
  if (!empty) PlaceWaiting(options, prior, &waiting, problem, rejected, go_on);
  if (empty || waiting.Remaining().size() > 1) {
    const MapProblem nothing = StartProblem(problem->modes.size(), problem->sensor);
    std::vector<JointMap> maps = Join(options, nothing, &waiting, rejected, go_on);
    if (empty && !maps.empty()) *problem = TakeLargest(&maps);
    std::vector<Submap> left;
    for (JointMap& map : maps) {
      std::optional<Submap> submap = ToSubmap(options, std::move(map), rejected);
      if (submap) left.push_back(*std::move(submap));
    }
    waiting = WaitingSubmaps(std::move(left), *problem);
    PlaceWaiting(options, prior, &waiting, problem, rejected, go_on);
  }
  for (const std::size_t i : waiting.Remaining()) {
    const Submap& submap = waiting.At(i);
    if (!waiting.Open(i)) {
      Reject(submap, NotAligned(submap), rejected);
      continue;
    }
    WaitingRuns& runs = problem->waiting.emplace_back();
    for (const BuildRun& run : submap.problem.runs) {
      runs.runs.push_back({run.data->name, run.data->sha256});
    }
    runs.explanations = *waiting.Open(i);
  }
}

}  // namespace shiftmap
