// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/unconfirmed_visits.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <optional>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapper/state/sightings.h"
#include "mapper/state/visit_ref.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Where the difference of a visit from its mode is known as well as that, the visit ties nothing,
// and selection decides. [m]
constexpr double kHarmlessSd = 0.3;

// Area that the sensor sees, a sector around the sightings of a run. [m²]
double SeenArea(const MappingRun& run) {
  constexpr double kLeast = 1e-3;  // All sightings may be straight ahead.
  double range = 0.0;
  double bearing = 0.0;
  for (const Sighting& sighting : run.sightings) {
    const Eigen::Vector2d q = sighting.observation.PositionInVehicle();
    range = std::max(range, q.norm());
    bearing = std::max(bearing, std::abs(std::atan2(q.y(), q.x())));
  }
  return std::max(kLeast, range * range * bearing);
}

// Probability that each visit is misread.
// @param right  Densities of the places as seen, if they are read right. [1/m²]
// @param misread  The same if they are not.
std::vector<double> MisreadProbabilities(const std::vector<double>& right, double misread) {
  constexpr int kIterations = 50;
  std::vector<double> probabilities(right.size());
  double share = 0.5;
  for (int i = 0; i < kIterations; ++i) {
    double sum = 1.0;  // Beside those of the run, one misread and one not.
    for (std::size_t k = 0; k < right.size(); ++k) {
      probabilities[k] = share * misread / (share * misread + (1.0 - share) * right[k]);
      sum += probabilities[k];
    }
    share = sum / (static_cast<double>(right.size()) + 2.0);
  }
  return probabilities;
}

// A visit, with a mode of its own in a probing build.
struct Probe {
  VisitRef visit;
  GroupModeIndex own;
};

// What the map has of a visit's place.
struct Match {
  double density = 0.0;      // Over all modes of the landmark. [1/m²]
  GroupModeIndex likeliest;  // Of these.
  double sd = 0.0;           // Of the difference from it, in the direction with the largest. [m]
};

// @param modes  Of the landmark, before it had those of the probes.
Match MatchOf(const ModeOptions& options,
              const BuildState& probing,
              const ModeDifferences& differences,
              const FlatModes& flat,
              const Probe& probe,
              std::size_t modes) {
  const GroupIndex group = VisitOf(probing, probe.visit).group;
  const GroupModes& all = probing.modes[group];
  const Eigen::Matrix2d floor =
      Eigen::Matrix2d::Identity() * (2.0 * options.position_floor_m * options.position_floor_m);
  Match match;
  double highest = -1.0;
  for (GroupModeIndex k(0); k.value() < static_cast<int>(modes); ++k) {
    const Eigen::Matrix2d S =
        differences.ApproximateCovariance(flat.Index(group, probe.own), flat.Index(group, k)) +
        floor;
    const double density =
        std::exp(LogGaussian(all[probe.own].p_map_landmark - all[k].p_map_landmark, S));
    match.density += density / static_cast<double>(modes);
    if (density <= highest) continue;
    highest = density;
    match.likeliest = k;
    match.sd = LargestSd(S);
  }
  return match;
}

// Visits that modes of their landmarks confirm.
int ConfirmByModes(const MapperOptions& options,
                   const std::vector<VisitRef>& visits,
                   BuildState* build) {
  BuildState probing = *build;
  IndexedVector<RunIndex, std::vector<Probe>> probes(build->runs.size());
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = VisitOf(*build, ref);
    const VisitCluster cluster =
        ClusterOf(build->runs[ref.run], visit, options.modes.cluster_radius_m);
    const GroupModeIndex own = AddMode(visit.group, {cluster.centre, kAbsent}, &probing);
    AssignmentOf(&probing, ref) = own;
    probes[ref.run].push_back({ref, own});
  }
  const Graph graph = MakeGraph(options, &probing);
  GraphSolver solver;
  const auto differences = ModeDifferences::Of(graph, &solver);
  if (!differences) return 0;
  const FlatModes flat(probing);
  int confirmed = 0;
  for (const RunIndex r : build->runs.indices()) {
    BuildRun& run = build->runs[r];
    std::vector<Match> matches;
    std::vector<double> densities;
    for (const Probe& probe : probes[r]) {
      const std::size_t modes = build->modes[VisitOf(probing, probe.visit).group].size();
      matches.push_back(MatchOf(options.modes, probing, *differences, flat, probe, modes));
      densities.push_back(matches.back().density);
    }
    const std::vector<double> misread = MisreadProbabilities(densities, 1.0 / SeenArea(*run.data));
    for (std::size_t i = 0; i < probes[r].size(); ++i) {
      const bool sure = misread[i] <= 1.0 - options.confirmation.min_probability;
      if (!sure && matches[i].sd > kHarmlessSd) continue;
      const VisitIndex v = probes[r][i].visit.visit;
      run.unconfirmed[v] = false;
      if (misread[i] < 0.5) run.assignment[v] = matches[i].likeliest;
      ++confirmed;
    }
  }
  return confirmed;
}

// Visits to landmarks without a mode that agree on a place, which gets one.
int ConfirmByEachOther(const ModeOptions& options,
                       const std::vector<VisitRef>& visits,
                       BuildState* build) {
  struct Seen {
    VisitRef visit;
    std::vector<Eigen::Vector2d> places;
  };
  std::map<GroupIndex, std::vector<Seen>> by_group;
  for (const VisitRef& ref : visits) {
    const MappingVisit& visit = VisitOf(*build, ref);
    by_group[visit.group].push_back({ref, VisitPositions(build->runs[ref.run], visit)});
  }
  int confirmed = 0;
  for (const auto& [group, seen] : by_group) {
    std::vector<Eigen::Vector2d> positions;
    for (const auto& [ref, places] : seen) {
      positions.insert(positions.end(), places.begin(), places.end());
    }
    const VisitCluster cluster = DensestCluster(positions, options.cluster_radius_m);
    if (cluster.count < options.min_sightings) continue;
    const GroupModeIndex mode = AddMode(group, {cluster.centre, kAbsent}, build);
    for (const auto& [ref, places] : seen) {
      const bool agrees =
          std::any_of(places.begin(), places.end(), [&](const Eigen::Vector2d& place) {
            return (place - cluster.centre).norm() <= options.cluster_radius_m;
          });
      if (!agrees) continue;
      build->runs[ref.run].unconfirmed[ref.visit] = false;
      AssignmentOf(build, ref) = mode;
      ++confirmed;
    }
  }
  return confirmed;
}

}  // namespace

IndexedVector<VisitIndex, bool> UnconfirmedVisits(const ModeOptions& options,
                                                  const MappingRun& run,
                                                  const FrameMotions& motions) {
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(motions);
  IndexedVector<VisitIndex, bool> unconfirmed(run.visits.size());
  std::size_t sightings = 0;
  for (const VisitIndex v : run.visits.indices()) {
    std::vector<Eigen::Vector2d> positions;
    for (const SightingIndex s : run.visits[v].sightings) {
      const Sighting& sighting = run.sightings[s];
      positions.push_back(poses[sighting.frame] * sighting.observation.PositionInVehicle());
    }
    const int agree = DensestCluster(positions, options.cluster_radius_m).count;
    unconfirmed[v] = agree < options.min_sightings;
    if (unconfirmed[v]) sightings += positions.size();
  }
  if (2 * sightings > run.sightings.size()) unconfirmed.assign(unconfirmed.size(), false);
  return unconfirmed;
}

bool MisreadsMany(const BuildState& build, const IndexedVector<VisitIndex, bool>& unconfirmed) {
  constexpr double kMany = 0.2;
  const BuildRun& run = build.runs.front();
  int all = 0;
  int misread = 0;
  for (const VisitIndex v : unconfirmed.indices()) {
    if (!unconfirmed[v]) continue;
    const std::vector<SightingIndex>& sightings = run.data->visits[v].sightings;
    ++all;
    misread += std::none_of(sightings.begin(), sightings.end(), [&](SightingIndex s) {
      return IsInlier(build, run, run.data->sightings[s]);
    });
  }
  return misread > kMany * all;
}

int ConfirmVisits(const MapperOptions& options, BuildState* build) {
  std::vector<VisitRef> of_modes;
  std::vector<VisitRef> without_mode;
  for (const RunIndex r : build->runs.indices()) {
    const BuildRun& run = build->runs[r];
    for (const VisitIndex v : run.unconfirmed.indices()) {
      if (!run.unconfirmed[v]) continue;
      const bool has_mode = !build->modes[run.data->visits[v].group].empty();
      (has_mode ? of_modes : without_mode).push_back({r, v});
    }
  }
  int confirmed = 0;
  if (!of_modes.empty()) confirmed += ConfirmByModes(options, of_modes, build);
  confirmed += ConfirmByEachOther(options.modes, without_mode, build);
  return confirmed;
}

}  // namespace shiftmap
