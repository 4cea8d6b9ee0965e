// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/run_among_others.h"

#include <algorithm>
#include <map>
#include <utility>
#include <vector>

#include "mapper/covariance/gauge.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/run_maps/single_run.h"
#include "mapper/state/sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

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

// Where most sightings of a visit agree. [m]
Eigen::Vector2d PlaceOf(const ModeOptions& options,
                        const BuildRun& run,
                        const MappingVisit& visit) {
  return ClusterOf(run, visit, options.cluster_radius_m).centre;
}

// A run by itself as it is assigned, with the modes of others held. What is unassigned is at modes
// of its own, but for visits that are not confirmed.
BuildState Among(const MapperOptions& options,
                 const BuildState& build,
                 const Owners& others,
                 const BuildRun& run) {
  BuildState alone;
  alone.sensor = build.sensor;
  alone.modes.resize(build.modes.size());
  alone.in_map_units = TellsScales(build);
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
    } else if (!run.IsUnconfirmed(v)) {
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

}  // namespace

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

ModeFilter HasOwner(const Owners& others) {
  return [&](GroupIndex group, GroupModeIndex mode) { return others[group][mode] > 0; };
}

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

bool MayBeDeformed(const MapperOptions& options,
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

IndexedVector<VisitIndex, OptionalMode> MatchVisits(const MapperOptions& options,
                                                    const BuildState& build,
                                                    const Owners& others,
                                                    const BuildRun& run,
                                                    double same_place_m) {
  IndexedVector<VisitIndex, OptionalMode> matches;
  for (const VisitIndex v : run.data->visits.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    const NearestMode nearest =
        FindNearest(build, visit.group, PlaceOf(options.modes, run, visit), HasOwner(others));
    const bool matches_it =
        !run.IsUnconfirmed(v) && nearest.squared_m2 < same_place_m * same_place_m;
    matches.push_back(matches_it ? nearest.mode : kUnassigned);
  }
  return matches;
}

BuildRun Pulled(const MapperOptions& options,
                const BuildState& build,
                const Owners& others,
                const BuildRun& run) {
  BuildRun pulled = run;
  for (const VisitIndex v : run.assignment.indices()) {
    const MappingVisit& visit = run.data->visits[v];
    if (run.IsUnconfirmed(v) || !MakesMode(options.modes, visit)) continue;
    const Eigen::Vector2d place = PlaceOf(options.modes, run, visit);
    pulled.assignment[v] = FindNearest(build, visit.group, place, HasOwner(others)).mode;
  }
  BuildState alone = Among(options, build, others, pulled);
  PullTogether(options, &alone);
  pulled.poses = std::move(alone.runs.front().poses);
  return pulled;
}

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

double CostAmong(const BuildState& solved) {
  const auto own = FlatModes(solved).end.value() - std::ssize(solved.priors);
  return solved.cost + kModeCost * static_cast<double>(own);
}

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

}  // namespace shiftmap
