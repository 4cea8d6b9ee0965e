// SPDX-License-Identifier: Apache-2.0
#include "mapper/state/sightings.h"

#include <algorithm>

#include "mapper/graph/residuals.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

VisitCluster DensestCluster(const std::vector<Eigen::Vector2d>& positions, double radius_m) {
  // More than this adds nothing but quadratic time.
  constexpr std::size_t kMaxCentres = 200;
  VisitCluster best;
  const std::size_t step = positions.size() / kMaxCentres + 1;
  for (std::size_t i = 0; i < positions.size(); i += step) {
    VisitCluster cluster;
    for (const Eigen::Vector2d& position : positions) {
      if ((position - positions[i]).norm() > radius_m) continue;
      cluster.centre += position;
      ++cluster.count;
    }
    if (cluster.count > best.count) {
      cluster.centre /= cluster.count;
      best = cluster;
    }
  }
  return best;
}

Innovation SightingInnovation(const BuildRun& run,
                              const Sighting& sighting,
                              const Eigen::Vector2d& p_map_landmark) {
  return LinearizeBiased(run.distortion.Undistorted(sighting.observation),
                         run.poses[sighting.frame],
                         p_map_landmark,
                         run.sensor_bias,
                         run.data->mean_squared_bearing);
}

const Eigen::Vector2d& AssignedPosition(const BuildState& build,
                                        const BuildRun& run,
                                        const Sighting& sighting) {
  const GroupModes& modes = build.modes[run.data->visits[sighting.visit].group];
  return modes[*run.assignment[sighting.visit]].p_map_landmark;
}

bool IsInlier(const BuildState& build, const BuildRun& run, const Sighting& sighting) {
  static const double gate = ChiSquareQuantile(kInlierProbability, 2);
  if (!run.assignment[sighting.visit]) return false;
  const Innovation innovation =
      SightingInnovation(run, sighting, AssignedPosition(build, run, sighting));
  return SquaredMahalanobis(innovation.nu, ObservationNoise(sighting.observation, build.sensor)) <
         gate;
}

bool MakesMode(const ModeOptions& options, const MappingVisit& visit) {
  return std::ssize(visit.sightings) >= options.min_sightings;
}

std::ptrdiff_t CountInliers(const BuildState& build, const VisitRef& ref) {
  const BuildRun& run = build.runs[ref.run];
  const std::vector<SightingIndex>& sightings = VisitOf(build, ref).sightings;
  return std::count_if(sightings.begin(), sightings.end(), [&](SightingIndex index) {
    return IsInlier(build, run, run.data->sightings[index]);
  });
}

std::vector<Eigen::Vector2d> VisitPositions(const BuildRun& run, const MappingVisit& visit) {
  std::vector<Eigen::Vector2d> positions;
  for (const SightingIndex index : visit.sightings) {
    const Sighting& sighting = run.data->sightings[index];
    const Observation observation = Unbiased(run.distortion.Undistorted(sighting.observation),
                                             run.sensor_bias,
                                             run.data->mean_squared_bearing);
    positions.push_back(LandmarkPosition(observation, run.poses[sighting.frame]));
  }
  return positions;
}

VisitCluster ClusterOf(const BuildRun& run, const MappingVisit& visit, double radius_m) {
  return DensestCluster(VisitPositions(run, visit), radius_m);
}

}  // namespace shiftmap
