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
                            const Alignment& alignment,
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
    const bool known = MeetsPrior(problem, encounter)
                           ? !displaced[i]
                           : encounter.squared_m2 < gate * (alignment.PositionVariance(position) +
                                                            2.0 * floor * floor);
    modes.push_back(known ? encounter.nearest : kUnassigned);
  }
  return modes;
}

// Per mode whether it meets the prior map and its landmark is not among those that stayed.
std::vector<bool> Others(const std::vector<int>& stayed,
                         const MapProblem& problem,
                         const std::vector<Encounter>& encounters) {
  std::vector<bool> others;
  for (const Encounter& encounter : encounters) {
    others.push_back(MeetsPrior(problem, encounter) &&
                     !std::binary_search(stayed.begin(), stayed.end(), encounter.group));
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
    known = KnownModes(options, aligned->alignment, submap, encounters, displaced, *problem);
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
  BuildRun& run = submap.problem.runs.front();
  for (std::size_t v = 0; v < run.assignment.size(); ++v) {
    int& assignment = run.assignment[v];
    const auto group = static_cast<std::size_t>(run.data->visits[v].group);
    if (assignment != kUnassigned)
      assignment = becomes[group][static_cast<std::size_t>(assignment)];
  }
  problem->runs.push_back(std::move(run));
  return true;
}

RejectedRun Rejected(const MappingRun& run, const std::string& why) {
  std::set<int> seen;
  for (const MappingVisit& visit : run.visits) seen.insert(visit.group);
  return {run.name, fmt::format("{} ({} landmarks seen)", why, seen.size())};
}

RejectedRun NotAligned(const MappingRun& run) {
  return Rejected(run, "no consistent alignment with the other runs");
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

// Whether the place of a submap is decided, which is then that of the likeliest explanation. Where
// that is about the one of the consensus, the latter stays as it is.
// @param explanations  Of a place that is not.
bool Confirm(const MapperOptions& options,
             const std::optional<MapContent>& prior,
             const MapProblem& problem,
             const Submap& submap,
             SubmapAlignment* aligned,
             std::optional<Explanations>* explanations) {
  *explanations = ExplainSubmap(options, prior, problem, AreaOf(problem), submap);
  if (!*explanations) return true;
  const Explanation* decided = Decided(options.confirmation, **explanations);
  if (decided == nullptr) return false;
  const auto apart = [&](const AlignmentPoint& point) {
    return (decided->alignment.T_reference_other * point.position -
            aligned->alignment.T_reference_other * point.position)
        .norm();
  };
  const bool same =
      std::all_of(submap.points.begin(), submap.points.end(), [&](const AlignmentPoint& point) {
        return apart(point) < options.confirmation.limits.same_frame_m;
      });
  if (!same) aligned->alignment = decided->alignment;
  aligned->stayed = decided->alignment.signatures;
  return true;
}

// Places a submap that waits, if it aligns and nothing else explains it.
void PlaceNext(const MapperOptions& options,
               const std::optional<MapContent>& prior,
               std::size_t next,
               WaitingSubmaps* waiting,
               MapProblem* problem,
               std::vector<RejectedRun>* rejected) {
  const std::vector<AlignmentPoint> reference = waiting->Reference(next, *problem);
  std::optional<SubmapAlignment> aligned =
      AlignSubmap(reference, waiting->At(next), AreaOf(*problem), options.alignment);
  if (!aligned) {
    waiting->SetAside(next);
    return;
  }
  std::optional<Explanations> explanations;
  if (!aligned->bent &&
      NeedsConfirmation(options.confirmation, reference, waiting->At(next), aligned->alignment) &&
      !Confirm(options, prior, *problem, waiting->At(next), &*aligned, &explanations)) {
    waiting->SetAside(next, std::move(explanations));
    return;
  }
  Submap placed = waiting->Take(next);
  const Se2& T_map_submap = aligned->alignment.T_reference_other;
  MoveProblem(T_map_submap, &placed.problem);
  Rotate(T_map_submap.Rotation(), &placed.covariance);
  const RejectedRun rejection = Rejected(*placed.problem.runs.front().data, kLooseReason);
  if (!Absorb(options, prior, aligned, std::move(placed), problem)) {
    rejected->push_back(rejection);
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

// A map that begins with one of the submaps.
struct Part {
  MapProblem problem;
  std::optional<std::size_t> first;
  std::optional<Submap> first_submap;  // As it was.
  bool open = false;                   // Others have several places in it.
};

// Without a prior map the submap of most landmarks is the first. It may be of another area: where
// more runs are left than were placed, they are placed by themselves, and the larger part is the
// map. A run that was a map by itself may lie in the larger one where explanations are open.
void PlaceMost(const MapperOptions& options,
               WaitingSubmaps* waiting,
               MapProblem* problem,
               std::vector<RejectedRun>* rejected,
               const GoOn& go_on) {
  const MapProblem nothing = *problem;
  Part most{nothing, std::nullopt, std::nullopt, false};
  std::vector<Part> beaten;
  do {
    Part part{nothing, std::nullopt, std::nullopt, false};
    waiting->Recount(part.problem);
    part.first = waiting->Largest();
    if (!part.first) break;
    part.first_submap = waiting->At(*part.first);
    Absorb(options, std::nullopt, std::nullopt, waiting->Take(*part.first), &part.problem);
    waiting->Update(*part.first, part.problem);
    PlaceWaiting(options, std::nullopt, waiting, &part.problem, rejected, go_on);
    part.open = waiting->AnyOpen();
    if (part.problem.runs.size() > most.problem.runs.size()) std::swap(part, most);
    const std::vector<RejectedRun>& left_out = part.problem.left_out;
    rejected->insert(rejected->end(), left_out.begin(), left_out.end());
    if (part.problem.runs.size() == 1 && part.open) {
      beaten.push_back(std::move(part));
    } else {
      for (const BuildRun& run : part.problem.runs) rejected->push_back(NotAligned(*run.data));
    }
    if (go_on && !go_on(most.problem)) break;
  } while (waiting->Remaining().size() > most.problem.runs.size());
  *problem = std::move(most.problem);
  if (beaten.empty()) return;
  for (Part& part : beaten) waiting->Return(*part.first, *std::move(part.first_submap));
  waiting->Recount(*problem);
  PlaceWaiting(options, std::nullopt, waiting, problem, rejected, go_on);
}

}  // namespace

void PlaceSubmaps(const MapperOptions& options,
                  const std::optional<MapContent>& prior,
                  std::vector<Submap> submaps,
                  MapProblem* problem,
                  std::vector<RejectedRun>* rejected,
                  const GoOn& go_on) {
  WaitingSubmaps waiting(std::move(submaps), *problem);
  const bool empty = std::all_of(problem->modes.begin(),
                                 problem->modes.end(),
                                 [](const auto& group) { return group.empty(); });
  if (empty) {
    PlaceMost(options, &waiting, problem, rejected, go_on);
  } else {
    PlaceWaiting(options, prior, &waiting, problem, rejected, go_on);
  }
  for (const std::size_t i : waiting.Remaining()) {
    const MappingRun& run = *waiting.At(i).problem.runs.front().data;
    if (waiting.Open(i)) {
      problem->waiting.push_back({run.name, run.sha256, *waiting.Open(i)});
    } else {
      rejected->push_back(NotAligned(run));
    }
  }
}

}  // namespace shiftmap
