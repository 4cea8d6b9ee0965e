// SPDX-License-Identifier: Apache-2.0
#include "mapper/single_run.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

#include "mapper/frontend/ekf_slam.h"
#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/pair_calibration.h"
#include "mapper/frontend/run_parts.h"
#include "mapper/graph/sensor_bias.h"
#include "mapper/mode_refinement.h"
#include "mapper/noise_calibration.h"
#include "mapper/submap.h"

namespace shiftmap {
namespace {

// Of the open loop, from dead reckoning.
constexpr int kSteps = 3;

// All runs together are asked again.
constexpr NoiseRounds kNoiseRounds{.most = 3, .settled = 1.2};

// One mode per group, where most of its sightings agree; visits that stand elsewhere come later.
void PlaceModes(double radius_m, MapProblem* problem) {
  BuildRun& run = problem->runs.front();
  problem->modes.assign(problem->signatures.size(), {});
  std::vector<std::vector<Eigen::Vector2d>> positions(problem->signatures.size());
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
  CalibrateNoise(options, kNoiseRounds, &open, &solver, go_on);
  *run = std::move(open.runs.front());
  *sensor = open.sensor;
}

// Maps a calibrated run from its poses on.
// @param problem  Of the run's signatures and sensor.
MapProblem MapFromPoses(const MapperOptions& options,
                        const MapProblem& problem,
                        const GoOn& go_on,
                        BuildRun run) {
  MapProblem mapped;
  mapped.signatures = problem.signatures;
  mapped.sensor = problem.sensor;
  mapped.runs.push_back(std::move(run));
  PlaceModes(options.modes.cluster_radius_m, &mapped);
  GraphSolver solver;
  AlternateModes(options, &mapped, &solver, go_on);  // All runs are solved again together.
  return mapped;
}

// The same with poses by EKF-SLAM.
MapProblem MapByEkf(const MapperOptions& options,
                    const MapProblem& problem,
                    const GoOn& go_on,
                    BuildRun run) {
  const SensorCalibration sensor =
      WithBias(problem.sensor, run.sensor_bias, run.data->mean_squared_bearing);
  run.poses = EstimateTrajectoryByEkf(*run.data, run.motions, {run.odometry, sensor});
  return MapFromPoses(options, problem, go_on, std::move(run));
}

// Groups with so many modes beside their first in one run are not landmarks that moved meanwhile:
// the vehicle came back and did not know where it was.
constexpr int kTorn = 4;

int ModesBesideFirst(const MapProblem& problem) {
  int count = 0;
  for (const std::vector<BuildMode>& group : problem.modes) {
    count += std::max(0, static_cast<int>(group.size()) - 1);
  }
  return count;
}

double CostOf(const MapProblem& problem) {
  return problem.cost + kModeCost * ModesBesideFirst(problem);
}

// Heading that odometry may lose in a part. [rad]
constexpr double kPartHeadingSd = 0.5;

// Poses of a run whose loops a filter did not find: it is mapped in parts that odometry by itself
// holds together, which are placed like runs. Nothing if `go_on` says no.
std::vector<Se2> PosesByParts(const MapperOptions& options,
                              const MapProblem& problem,
                              const GoOn& go_on,
                              const BuildRun& run) {
  const double noise = std::max(1e-3, run.odometry.noise_omega);
  RunParts parts(*run.data, std::pow(kPartHeadingSd / noise, 2));
  std::vector<Submap> submaps;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    MapProblem part = MapPart(options, problem, run, parts.At(k), go_on);
    if (go_on && !go_on(part)) return {};
    submaps.push_back(MakeSubmap(options, std::move(part)));
  }
  MapProblem placed = StartProblem(problem.signatures, std::nullopt, problem.sensor);
  std::vector<RejectedRun> rejected;
  PlaceSubmaps(options, std::nullopt, std::move(submaps), &placed, &rejected, go_on);
  if (go_on && !go_on(placed)) return {};
  for (BuildRun& part : placed.runs) {
    parts.Place(static_cast<std::size_t>(part.data - &parts.At(0)), std::move(part.poses));
  }
  return parts.Poses(run.motions);
}

}  // namespace

MapProblem MapPart(const MapperOptions& options,
                   const MapProblem& problem,
                   const BuildRun& run,
                   const MappingRun& part,
                   const GoOn& go_on) {
  BuildRun of_part;
  of_part.data = &part;
  of_part.odometry = run.odometry;
  of_part.sensor_bias = run.sensor_bias;
  of_part.motions = IntegrateMotions(part, run.odometry);
  return MapByEkf(options, problem, go_on, std::move(of_part));
}

MapProblem MapSingleRun(const MappingRun& run,
                        const std::vector<Signature>& signatures,
                        const MapperOptions& options,
                        const GoOn& go_on) {
  MapProblem nothing;
  nothing.signatures = signatures;
  nothing.sensor = options.calibration.sensor;
  BuildRun build;
  build.data = &run;
  build.odometry = options.calibration.odometry;
  if (options.calibrate) CalibrateOpen(options, signatures.size(), go_on, &build, &nothing.sensor);
  UpdateMotions(run, build.odometry, &build.motions);
  MapProblem by_ekf = MapByEkf(options, nothing, go_on, build);
  if (ModesBesideFirst(by_ekf) < kTorn) return by_ekf;
  build.poses = PosesByParts(options, nothing, go_on, build);
  if (build.poses.empty()) return by_ekf;
  MapProblem by_parts = MapFromPoses(options, nothing, go_on, std::move(build));
  return CostOf(by_parts) < CostOf(by_ekf) ? std::move(by_parts) : std::move(by_ekf);
}

}  // namespace shiftmap
