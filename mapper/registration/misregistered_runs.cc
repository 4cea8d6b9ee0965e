// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/misregistered_runs.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <map>
#include <optional>
#include <set>
#include <utility>
#include <vector>

#include "mapper/alignment/explanation.h"
#include "mapper/covariance/gauge.h"
#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/run_parts.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/parallel.h"
#include "mapper/registration/misfit_runs.h"
#include "mapper/registration/mode_match.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/state/sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Per group and mode, how many runs have it. That the prior map does counts for nothing: landmarks
// may have moved since.
using Owners = IndexedVector<GroupIndex, IndexedVector<GroupModeIndex, int>>;

void AddOwner(const BuildRun& run, int change, Owners* owners) {
  for (const auto& [group, mode] : ModesOf(run)) {
    (*owners)[group][mode] += change;
  }
}

Owners OwnersOf(const BuildState& build) {
  Owners owners;
  for (const GroupModes& group : build.modes) owners.emplace_back(group.size());
  for (const BuildRun& run : build.runs) AddOwner(run, 1, &owners);
  return owners;
}

// How the visits of a run, or of a stretch of it, agree with the others. Only visits that make a
// mode count.
struct Agreement {
  int shared = 0;                  // Are where others have their landmark.
  int contradicting = 0;           // Are of landmarks that others know elsewhere.
  int contradicting_row = 0;       // Most of these in a row.
  std::set<GroupIndex> elsewhere;  // Their landmarks.
};

Agreement AgreementOf(
    const ModeOptions& options, const BuildRun& run, const Owners& others, Stamp begin, Stamp end) {
  Agreement agreement;
  int in_row = 0;
  for (const VisitIndex v : run.assignment.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    const OptionalMode mode = run.assignment[v];
    if (!mode || !MakesMode(options, visit)) continue;
    if (visit.begin < begin || visit.begin > end) continue;
    const auto& group = others[visit.group];
    if (group[*mode] > 0) {
      ++agreement.shared;
      in_row = 0;
    } else if (std::any_of(group.begin(), group.end(), [](int count) { return count > 0; })) {
      ++agreement.contradicting;
      agreement.elsewhere.insert(visit.group);
      agreement.contradicting_row = std::max(agreement.contradicting_row, ++in_row);
    }
  }
  return agreement;
}

Agreement AgreementOf(const ModeOptions& options, const BuildRun& run, const Owners& others) {
  const auto& frames = run.data->frames;
  return AgreementOf(options, run, others, frames.front().stamp, frames.back().stamp);
}

ModeFilter HasOwner(const Owners& others) {
  return [&](GroupIndex group, GroupModeIndex mode) { return others[group][mode] > 0; };
}

// A landmark that others know elsewhere. [m]
struct Displaced {
  Eigen::Vector2d place;
  Eigen::Vector2d displacement;  // To where others have it.
};

// In the order in which the run saw them.
std::vector<Displaced> DisplacedLandmarks(const MapperOptions& options,
                                          const BuildState& build,
                                          const Owners& others,
                                          const BuildRun& run) {
  std::vector<Displaced> displaced;
  std::set<GroupIndex> seen;
  for (const VisitIndex v : run.assignment.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    const OptionalMode mode = run.assignment[v];
    if (!mode || !MakesMode(options.modes, visit) || others[visit.group][*mode] > 0) continue;
    const GroupModes& modes = build.modes[visit.group];
    const Eigen::Vector2d place = modes[*mode].p_map_landmark;
    const OptionalMode known = FindNearest(build, visit.group, place, HasOwner(others)).mode;
    if (!known || !seen.insert(visit.group).second) continue;
    displaced.push_back({place, modes[*known].p_map_landmark - place});
  }
  return displaced;
}

// Whether a part of a run may be bent rather than its landmarks moved: some in a row, but for one
// between two of them, are displaced together. Landmarks that moved went each its own way.
bool MayBeBent(const MapperOptions& options,
               const BuildState& build,
               const Owners& others,
               const BuildRun& run) {
  const std::vector<Displaced> displaced = DisplacedLandmarks(options, build, others, run);
  std::vector<std::size_t> in_row;
  for (std::size_t i = 0; i < displaced.size(); ++i) {
    std::size_t most = 1;
    for (std::size_t j = i < 2 ? 0 : i - 2; j < i; ++j) {
      const double apart = (displaced[i].place - displaced[j].place).norm();
      const double differ = (displaced[i].displacement - displaced[j].displacement).norm();
      const double limit =
          options.relocation.same_place_m + options.relocation.max_turn_rad * apart;
      if (differ <= limit) most = std::max(most, in_row[j] + 1);
    }
    if (most >= kMinPartSignatures) return true;
    in_row.push_back(most);
  }
  return false;
}

// The modes of others in the groups that a run has seen.
AlignmentPoints Reference(const BuildState& build, const Owners& others, const BuildRun& run) {
  std::set<GroupIndex> groups;
  for (const MappingVisit& visit : run.data->visits) groups.insert(visit.group);
  return PointsOfGroups(build, groups, HasOwner(others));
}

// Where most sightings of a visit agree. [m]
Eigen::Vector2d PlaceOf(const ModeOptions& options,
                        const BuildRun& run,
                        const MappingVisit& visit) {
  return ClusterOf(run, visit, options.cluster_radius_m).centre;
}

// Per visit of a run the mode of others that it is at, nearer than a distance, or kUnassigned.
IndexedVector<VisitIndex, OptionalMode> MatchVisits(const MapperOptions& options,
                                                    const BuildState& build,
                                                    const Owners& others,
                                                    const BuildRun& run,
                                                    double same_place_m) {
  IndexedVector<VisitIndex, OptionalMode> matches;
  for (const MappingVisit& visit : run.data->visits) {
    const NearestMode nearest =
        FindNearest(build, visit.group, PlaceOf(options.modes, run, visit), HasOwner(others));
    const bool matches_it = nearest.squared_m2 < same_place_m * same_place_m;
    matches.push_back(matches_it ? nearest.mode : kUnassigned);
  }
  return matches;
}

// A run in parts, and the poses of those that align with the others, none of the rest.
struct AlignedParts {
  RunParts parts;
  std::vector<std::vector<Se2>> poses;
};

// Nothing if `on_step` says no.
std::optional<AlignedParts> AlignParts(const MapperOptions& options,
                                       const BuildState& build,
                                       const Owners& others,
                                       const BuildRun& run,
                                       const StepCallback& on_step) {
  const MappingRun& data = *run.data;
  const auto visits =
      std::count_if(data.visits.begin(), data.visits.end(), [&](const MappingVisit& visit) {
        return MakesMode(options.modes, visit);
      });
  const double part_s =
      DurationOf(data) * options.relocation.part_visits / static_cast<double>(visits);
  AlignedParts aligned{RunParts(data, part_s, BrokenMotions(run.motions)), {}};
  const AlignmentPoints reference = Reference(build, others, run);
  const double area = OccupiedArea(PositionsOf(reference));
  for (std::size_t k = 0; k < aligned.parts.size(); ++k) {
    BuildState part = MapPart(options, build, run, aligned.parts.At(k), on_step);
    if (on_step && !on_step(part)) return std::nullopt;
    std::vector<Se2>& poses = aligned.poses.emplace_back();
    const std::optional<RunMap> run_map = MakeRunMap(options, std::move(part));
    if (!run_map) continue;
    const auto found = AlignRunMap(reference, *run_map, area, options.alignment);
    if (!found || found->alignment.signatures.size() < kMinPartSignatures) continue;
    for (const Se2& pose : run_map->build.runs.front().poses) {
      poses.push_back(found->alignment.T_reference_other * pose);
    }
  }
  return aligned;
}

// The run with its poses where its parts align with the others, if any does.
// @param keep  Parts that agree with the others stay where they are.
std::optional<BuildRun> Realigned(const MapperOptions& options,
                                  const BuildState& build,
                                  const Owners& others,
                                  const BuildRun& run,
                                  bool keep,
                                  AlignedParts* aligned) {
  bool any = false;
  auto first = run.poses.begin();
  for (std::size_t k = 0; k < aligned->parts.size(); ++k) {
    const auto& frames = aligned->parts.At(k).frames;
    const auto begin = std::exchange(first, first + std::ssize(frames));
    const Agreement agreement =
        AgreementOf(options.modes, run, others, frames.front().stamp, frames.back().stamp);
    if (keep && agreement.shared > agreement.contradicting) {
      aligned->parts.Place(k, {begin, first});
    } else {
      aligned->parts.Place(k, aligned->poses[k]);
      any = any || !aligned->poses[k].empty();
    }
  }
  if (!any) return std::nullopt;
  BuildRun realigned = run;
  realigned.poses = aligned->parts.Poses(run.motions);
  realigned.assignment =
      MatchVisits(options, build, others, realigned, options.relocation.same_place_m);
  return realigned;
}

// A run by itself as it is assigned, with the modes of others held. What is unassigned is at modes
// of its own.
BuildState Among(const MapperOptions& options,
                 const BuildState& build,
                 const Owners& others,
                 const BuildRun& run) {
  BuildState alone;
  alone.sensor = build.sensor;
  alone.modes.resize(build.modes.size());
  alone.runs.push_back(run);
  auto& assignment = alone.runs.front().assignment;
  std::map<BuildModeRef, GroupModeIndex> known;  // Modes of the build, by their index in `alone`.
  std::vector<BuildModeRef> held;                // In `alone`.
  for (const VisitIndex v : assignment.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    const GroupIndex group = visit.group;
    GroupModes& modes = alone.modes[group];
    if (const OptionalMode mode = assignment[v]) {
      const auto [entry, added] = known.try_emplace({group, *mode}, modes.end_index());
      assignment[v] = entry->second;
      if (!added) continue;
      modes.push_back(build.modes[group][*mode]);
      if (others[group][*mode] > 0) held.push_back({group, entry->second});
    } else {
      const Eigen::Vector2d place = PlaceOf(options.modes, run, visit);
      const auto near = std::find_if(modes.begin(), modes.end(), [&](const BuildMode& other) {
        return (other.p_map_landmark - place).norm() < options.relocation.same_place_m;
      });
      assignment[v] = GroupModeIndex(near - modes.begin());
      if (near == modes.end()) modes.push_back({place, kAbsent});
    }
  }
  const FlatModes flat(alone);
  std::vector<ModeIndex> held_modes;
  std::vector<Eigen::Vector2d> places;
  for (const auto& [group, mode] : held) {
    held_modes.push_back(flat.Index(group, mode));
    places.push_back(alone.modes[group][mode].p_map_landmark);
  }
  alone.priors = HoldModes(held_modes, places, options.modes.position_floor_m);
  return alone;
}

// The same, solved.
BuildState SolvedAmong(const MapperOptions& options,
                       const BuildState& build,
                       const Owners& others,
                       const BuildRun& run) {
  BuildState alone = Among(options, build, others, run);
  SolveContinuous(options, &alone);  // Its parts may be metres from where they belong.
  alone.loss_reach = build.loss_reach;
  SolveContinuous(options, &alone);
  return alone;
}

// What a run costs among others, with its own modes.
double CostAmong(const BuildState& solved) {
  const auto own = FlatModes(solved).end.value() - std::ssize(solved.priors);
  return solved.cost + kModeCost * static_cast<double>(own);
}

// Whether others bend a run by no more than its errors and theirs do.
bool FitsAmong(const MapperOptions& options, BuildState solved) {
  const double joined = solved.cost;
  const auto held = static_cast<int>(solved.priors.size());
  solved.priors.clear();
  SolveContinuous(options, &solved);
  const double limit =
      options.deformation.variance_factor *
      ChiSquareQuantile(options.deformation.contradiction, std::max(1, 2 * held - 3));
  return 2.0 * (joined - solved.cost) <= limit;
}

// The run with each landmark at the place of others that it is nearest to, whatever that bends.
BuildRun Pulled(const MapperOptions& options,
                const BuildState& build,
                const Owners& others,
                const BuildRun& run) {
  BuildRun pulled = run;
  for (const VisitIndex v : run.assignment.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    if (!MakesMode(options.modes, visit)) continue;
    const Eigen::Vector2d place = PlaceOf(options.modes, run, visit);
    pulled.assignment[v] = FindNearest(build, visit.group, place, HasOwner(others)).mode;
  }
  BuildState alone = Among(options, build, others, pulled);
  PullTogether(options, &alone);
  pulled.poses = std::move(alone.runs.front().poses);
  return pulled;
}

// The run pulled to the places of others. A visit that is not at one then, to half of the distance
// that counts for parts that may be turned, is of a landmark that moved.
BuildRun PulledOnto(const MapperOptions& options,
                    const BuildState& build,
                    const Owners& others,
                    const BuildRun& run) {
  BuildRun pulled = Pulled(options, build, others, run);
  pulled.assignment =
      MatchVisits(options, build, others, pulled, 0.5 * options.relocation.same_place_m);
  return pulled;
}

// The run with stayed and moved exchanged: the landmarks that it has elsewhere are where others
// have them. Of its other landmarks those have moved that the pulled run has elsewhere.
BuildRun Exchanged(const MapperOptions& options,
                   const BuildState& build,
                   const Owners& others,
                   const std::set<GroupIndex>& elsewhere,
                   const BuildRun& run) {
  BuildRun exchanged = Pulled(options, build, others, run);
  const auto there =
      MatchVisits(options, build, others, exchanged, 0.25 * options.relocation.same_place_m);
  for (const VisitIndex v : there.indices()) {
    if (!elsewhere.contains(run.data->visits[v].group)) exchanged.assignment[v] = there[v];
  }
  return exchanged;
}

// A misregistered run where it costs less than where it is, or nothing.
std::optional<BuildRun> Relocate(const MapperOptions& options,
                                 const BuildState& build,
                                 const Owners& others,
                                 const BuildRun& run,
                                 const StepCallback& on_step) {
  const Agreement before = AgreementOf(options.modes, run, others);
  const bool lays_second_map = before.contradicting_row >= options.relocation.min_visits;
  if (!lays_second_map && (std::ssize(before.elsewhere) < options.relocation.min_visits ||
                           !MayBeBent(options, build, others, run))) {
    return std::nullopt;
  }
  std::optional<double> least;  // Solved for only if a candidate is to be held against it.
  std::optional<BuildRun> best;
  const auto consider = [&](BuildRun moved, bool has_to_fit) {
    if (AgreementOf(options.modes, moved, others).shared <= before.shared) return;
    if (!least) least = CostAmong(SolvedAmong(options, build, others, run));
    const BuildState solved = SolvedAmong(options, build, others, moved);
    const double cost = CostAmong(solved);
    if (cost >= *least || (has_to_fit && !FitsAmong(options, solved))) return;
    least = cost;
    best = std::move(moved);
  };
  consider(PulledOnto(options, build, others, run), true);
  if (!lays_second_map) return best;
  std::optional<AlignedParts> aligned = AlignParts(options, build, others, run, on_step);
  if (!aligned) return std::nullopt;
  for (const bool keep : {true, false}) {
    std::optional<BuildRun> moved = Realigned(options, build, others, run, keep, &*aligned);
    if (moved) consider(*std::move(moved), false);
  }
  return best;
}

// Groups of a run that are where others have them.
std::vector<GroupIndex> StayedGroups(const Owners& others, const BuildRun& run) {
  std::vector<GroupIndex> groups;
  for (const auto& [group, mode] : ModesOf(run)) {
    if (others[group][mode] > 0 && (groups.empty() || groups.back() != group)) {
      groups.push_back(group);
    }
  }
  return groups;
}

// Beyond this, odds are no more told apart.
constexpr double kMaxLogOdds = 50.0;

// A run of which the landmarks that seem to have moved may be those that stayed.
struct UndecidedRun {
  RunIndex run;
  double excess = 0.0;  // How much more it costs that they stayed.
  Explanations explanations;
};

std::optional<UndecidedRun> FindUndecided(const MapperOptions& options,
                                          const BuildState& build,
                                          const Owners& others,
                                          RunIndex r) {
  const BuildRun& run = build.runs[r];
  if (std::ssize(ModesOf(run)) > options.confirmation.max_modes) return std::nullopt;
  if (!MayBeBent(options, build, others, run)) return std::nullopt;
  const std::set<GroupIndex> elsewhere = AgreementOf(options.modes, run, others).elsewhere;
  const BuildRun exchanged = Exchanged(options, build, others, elsewhere, run);
  const double excess = CostAmong(SolvedAmong(options, build, others, exchanged)) -
                        CostAmong(SolvedAmong(options, build, others, run));
  if (!(excess < kModeCost)) return std::nullopt;  // Nor if either solve diverged.
  const std::vector<GroupIndex> stayed = StayedGroups(others, run);
  const std::vector<GroupIndex> stayed_then = StayedGroups(others, exchanged);
  std::vector<GroupIndex> groups;
  std::set_union(stayed.begin(),
                 stayed.end(),
                 stayed_then.begin(),
                 stayed_then.end(),
                 std::back_inserter(groups));
  const double probability = 1.0 / (1.0 + std::exp(std::min(-excess, kMaxLogOdds)));
  return UndecidedRun{
      r,
      excess,
      DescribeFrames({DescribeFrame({{stayed, probability}}, stayed, groups),
                      DescribeFrame({{stayed_then, 1.0 - probability}}, stayed_then, groups)})};
}

}  // namespace

bool RemoveUndecidedRun(const MapperOptions& options,
                        BuildState* build,
                        const StepCallback& on_step) {
  MapperOptions of_one = options;
  of_one.threads = 1;
  const Owners owners = OwnersOf(*build);
  std::vector<std::optional<UndecidedRun>> undecided(build->runs.size());
  ForEachIndex(build->runs.size(), options.threads, [&](std::size_t i) {
    if (on_step && !on_step(*build)) return;
    const RunIndex r(i);
    Owners others = owners;
    AddOwner(build->runs[r], -1, &others);
    undecided[i] = FindUndecided(of_one, *build, others, r);
  });
  std::optional<UndecidedRun> worst;
  for (std::optional<UndecidedRun>& found : undecided) {
    if (found && (!worst || found->excess <= worst->excess)) worst = std::move(found);
  }
  if (!worst) return false;
  LetWait(worst->run, build).explanations = std::move(worst->explanations);
  return true;
}

int RelocateMisregisteredRuns(const MapperOptions& options,
                              BuildState* build,
                              const StepCallback& on_step) {
  Owners owners = OwnersOf(*build);
  int count = 0;
  for (BuildRun& run : build->runs) {
    if (on_step && !on_step(*build)) break;
    AddOwner(run, -1, &owners);
    if (std::optional<BuildRun> moved = Relocate(options, *build, owners, run, on_step)) {
      run = *std::move(moved);
      ++count;
    }
    AddOwner(run, 1, &owners);
  }
  if (count > 0) DropUnusedModes(build);
  return count;
}

}  // namespace shiftmap
