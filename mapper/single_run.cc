// SPDX-License-Identifier: Apache-2.0
#include "mapper/single_run.h"

#include <cstddef>
#include <utility>

#include "mapper/frontend/ekf_slam.h"
#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/pair_calibration.h"
#include "mapper/graph/sensor_bias.h"
#include "mapper/mode_refinement.h"
#include "mapper/noise_calibration.h"

namespace shiftmap {
namespace {

// Of the open loop, from dead reckoning.
constexpr int kSteps = 3;

// All runs together are asked again.
constexpr NoiseRounds kNoiseRounds{.most = 3, .settled = 1.2};

// One mode per group, where most of its sightings agree; visits that stand elsewhere come later.
void PlaceModes(const std::vector<Signature>& signatures, double radius_m, MapProblem* problem) {
  BuildRun& run = problem->runs.front();
  problem->modes.assign(signatures.size(), {});
  std::vector<std::vector<Eigen::Vector2d>> positions(signatures.size());
  for (const MappingVisit& visit : run.data->visits) {
    const std::vector<Eigen::Vector2d> seen = VisitPositions(run, visit);
    std::vector<Eigen::Vector2d>& all = positions[static_cast<std::size_t>(visit.group)];
    all.insert(all.end(), seen.begin(), seen.end());
  }
  for (std::size_t group = 0; group < positions.size(); ++group) {
    if (positions[group].empty()) continue;
    problem->modes[group].push_back({DensestCluster(positions[group], radius_m).centre, kAbsent});
  }
  run.assignment.assign(run.data->visits.size(), 0);
}

// Calibrates the odometry's scales, lag and noise and the sensor's errors and noise with every
// visit a landmark of its own. No loop is closed then, by a heading that is a radian off or at all,
// and dead reckoning is a start that is near enough. Poses and assignments of it are left in *run.
void CalibrateOpen(const MapperOptions& options,
                   std::size_t groups,
                   const GoOn& go_on,
                   BuildRun* run,
                   SensorCalibration* sensor) {
  const Calibration start = CalibrateFromPairs(*run->data, options.calibration);
  MapProblem open;
  open.sensor = start.sensor;
  open.open = true;
  open.modes.resize(groups);
  run->odometry = start.odometry;
  run->motions = IntegrateMotions(*run->data, run->odometry);
  run->poses = DeadReckon(run->motions);
  for (const MappingVisit& visit : run->data->visits) {
    std::vector<BuildMode>& modes = open.modes[static_cast<std::size_t>(visit.group)];
    run->assignment.push_back(static_cast<int>(modes.size()));
    const std::vector<Eigen::Vector2d> seen = VisitPositions(*run, visit);
    modes.push_back({DensestCluster(seen, options.modes.cluster_radius_m).centre, kAbsent});
  }
  open.runs.push_back(std::move(*run));
  GraphSolver solver;
  SolveRoughly(options, kSteps, &open, &solver);
  CalibrateNoise(options, kNoiseRounds, &open, go_on);
  *run = std::move(open.runs.front());
  *sensor = open.sensor;
}

}  // namespace

MapProblem MapSingleRun(const MappingRun& run,
                        const std::vector<Signature>& signatures,
                        const MapperOptions& options,
                        const GoOn& go_on) {
  MapProblem problem;
  problem.signatures = signatures;
  problem.sensor = options.calibration.sensor;
  BuildRun build;
  build.data = &run;
  build.odometry = options.calibration.odometry;
  if (options.calibrate) {
    CalibrateOpen(options, signatures.size(), go_on, &build, &problem.sensor);
  }
  UpdateMotions(run, build.odometry, &build.motions);
  build.poses = EstimateTrajectoryByEkf(
      run,
      build.motions,
      {build.odometry, WithBias(problem.sensor, build.sensor_bias, run.mean_squared_bearing)});
  problem.runs.push_back(std::move(build));
  PlaceModes(signatures, options.modes.cluster_radius_m, &problem);
  AlternateModes(options, &problem, go_on);  // All runs are solved again together.
  return problem;
}

}  // namespace shiftmap
