// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/single_run.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "mapper/calibration/implausible_calibration.h"
#include "mapper/calibration/noise_calibration.h"
#include "mapper/frontend/ekf_slam.h"
#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/pair_calibration.h"
#include "mapper/frontend/run_parts.h"
#include "mapper/graph/graph.h"
#include "mapper/graph/sensor_bias.h"
#include "mapper/modes/mode_merging.h"
#include "mapper/modes/mode_refinement.h"
#include "mapper/registration/place_run_maps.h"
#include "mapper/run_maps/broken_motion.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/unconfirmed_visits.h"
#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// Of the open loop, from dead reckoning.
constexpr int kSteps = 3;

// All runs together are asked again.
constexpr NoiseRounds kNoiseRounds{.most = 3, .settled = 1.2};

// One mode per group, where most of its sightings agree; visits that stand elsewhere come later.
void PlaceModes(double radius_m, BuildState* build) {
  BuildRun& run = build->runs.front();
  IndexedVector<GroupIndex, std::vector<Eigen::Vector2d>> positions(build->modes.size());
  run.assignment.assign(run.data->visits.size(), kUnassigned);
  for (const VisitIndex v : run.data->visits.indices()) {
    run.assignment[v] = GroupModeIndex(0);
    const MappingVisit& visit = run.data->visits[v];
    const std::vector<Eigen::Vector2d> seen = VisitPositions(run, visit);
    std::vector<Eigen::Vector2d>& all = positions[visit.group];
    all.insert(all.end(), seen.begin(), seen.end());
  }
  for (const GroupIndex group : positions.indices()) {
    if (positions[group].empty()) continue;
    build->modes[group].push_back({DensestCluster(positions[group], radius_m).centre, kAbsent});
  }
}

// Calibrates the odometry's scales, lag and noise and the sensor's errors and noise with every
// visit a landmark of its own. No loop is closed then, by a heading that is a radian off or at all,
// and dead reckoning is a start that is near enough. Poses and assignments of it are left in *run.
void CalibrateOpen(const MapperOptions& options,
                   std::size_t groups,
                   const StepCallback& on_step,
                   BuildRun* run,
                   SensorCalibration* sensor) {
  const Calibration start = CalibrateFromPairs(*run->data, options.calibration);
  BuildState open;
  open.sensor = start.sensor;
  open.open = true;
  open.modes.resize(groups);
  run->odometry = start.odometry;
  run->motions = IntegrateMotions(*run->data, run->odometry);
  run->poses = DeadReckon(run->motions);
  run->assignment.assign(run->data->visits.size(), kUnassigned);
  for (const VisitIndex v : run->data->visits.indices()) {
    const MappingVisit& visit = run->data->visits[v];
    GroupModes& modes = open.modes[visit.group];
    run->assignment[v] = modes.end_index();
    modes.push_back({ClusterOf(*run, visit, options.modes.cluster_radius_m).centre, kAbsent});
  }
  open.runs.push_back(std::move(*run));
  GraphSolver solver;
  SolveTruncated(options, kSteps, &open, &solver);
  CalibrateNoise(options, kNoiseRounds, &open, &solver, on_step);
  *run = std::move(open.runs.front());
  *sensor = open.sensor;
}

// A run with a mode per group by its poses.
// @param build  Whose groups and sensor it has.
BuildState OneModeEach(const MapperOptions& options, const BuildState& build, BuildRun run) {
  BuildState result = StartBuild(build.modes.size(), build.sensor);
  result.runs.push_back(std::move(run));
  PlaceModes(options.modes.cluster_radius_m, &result);
  return result;
}

// Maps a calibrated run from its poses on.
BuildState MapOnce(const MapperOptions& options,
                   const BuildState& build,
                   const StepCallback& on_step,
                   BuildRun run) {
  BuildState mapped = OneModeEach(options, build, std::move(run));
  GraphSolver solver;
  AlternateModes(options, &mapped, &solver, on_step);  // All runs are solved again together.
  return mapped;
}

int ModesBesideFirst(const BuildState& build) {
  int count = 0;
  for (const GroupModes& group : build.modes) {
    count += std::max(0, static_cast<int>(group.size()) - 1);
  }
  return count;
}

// A break is as improbable as that the landmarks moved that it needs.
double CostOf(const BuildState& build) {
  const auto breaks = static_cast<double>(BrokenMotions(build.runs.front().motions).size());
  return build.cost + kModeCost * (ModesBesideFirst(build) + kLeastMoved * breaks);
}

// Poses of a run from which every landmark stands at one place, whatever that bends.
IndexedVector<FrameIndex, Se2> PulledTogether(const MapperOptions& options,
                                              const BuildState& build,
                                              BuildRun run) {
  BuildState whole = OneModeEach(options, build, std::move(run));
  BuildRun& pulled = whole.runs.front();
  for (const VisitIndex v : pulled.assignment.indices()) {
    if (!MakesMode(options.modes, pulled.data->visits[v])) pulled.assignment[v] = kUnassigned;
  }
  DropUnusedModes(&whole);
  PullTogether(options, &whole);
  return std::move(pulled.poses);
}

// The same as MapOnce(), and where landmarks seem to have moved, the cheaper of two maps: to poses
// that start metres off what does not fit is an outlier or another mode, and pulls no more.
BuildState MapFromPoses(const MapperOptions& options,
                        const BuildState& build,
                        const StepCallback& on_step,
                        BuildRun run) {
  BuildState mapped = MapOnce(options, build, on_step, run);
  if (ModesBesideFirst(mapped) == 0 || (on_step && !on_step(mapped))) return mapped;
  run.poses = mapped.runs.front().poses;
  run.poses = PulledTogether(options, build, run);
  BuildState pulled = MapOnce(options, build, on_step, std::move(run));
  return CostOf(pulled) < CostOf(mapped) ? std::move(pulled) : std::move(mapped);
}

// The same with poses by EKF-SLAM.
BuildState MapByEkf(const MapperOptions& options,
                    const BuildState& build,
                    const StepCallback& on_step,
                    BuildRun run) {
  const SensorCalibration sensor =
      WithBias(build.sensor, run.sensor_bias, run.data->mean_squared_bearing);
  run.poses = EstimateTrajectoryByEkf(*run.data, run.motions, {run.odometry, sensor});
  return MapFromPoses(options, build, on_step, std::move(run));
}

// A run has an open loop if its landmarks have so many second modes, in number and as a share of
// the groups: fewer landmarks move during a run.
constexpr int kInconsistent = 4;
constexpr double kInconsistentShare = 0.02;

bool IsInconsistent(const BuildState& build) {
  const auto groups = static_cast<double>(std::count_if(
      build.modes.begin(), build.modes.end(), [](const auto& modes) { return !modes.empty(); }));
  return ModesBesideFirst(build) >= std::max<double>(kInconsistent, kInconsistentShare * groups);
}

// Heading that odometry may lose in a part. [rad]
constexpr double kPartHeadingSd = 0.5;

// Landmarks in a part at most, but for short ones: what a filter costs goes with their square.
constexpr std::ptrdiff_t kMaxPartLandmarks = 300;
constexpr double kShortPart = 60.0;  // [s]

// Landmarks in a run from which on its parts cost less than the run as a whole.
constexpr std::ptrdiff_t kManyLandmarks = 100;

// Landmarks that a part of a run saw well enough for a mode: of the part with most.
std::ptrdiff_t MostLandmarks(const ModeOptions& options, const MappingRun& run, double part_s) {
  const auto part_at = [&](Stamp stamp) {
    return std::floor(ToSeconds(stamp - run.frames.front().stamp) / part_s);
  };
  std::map<double, std::set<GroupIndex>> seen;  // Per part its groups.
  for (const MappingVisit& visit : run.visits) {
    if (!MakesMode(options, visit)) continue;
    seen[part_at(visit.begin)].insert(visit.group);
    seen[part_at(visit.end)].insert(visit.group);
  }
  std::ptrdiff_t most = 0;
  for (const auto& [part, groups] : seen) most = std::max(most, std::ssize(groups));
  return most;
}

// Of a part that odometry by itself holds together, and that a filter does not take long for. [s]
double PartDuration(const ModeOptions& options, const BuildRun& run) {
  constexpr double kShorter = 0.8;
  const double noise = std::max(1e-3, run.odometry.noise_omega);
  double part_s = std::pow(kPartHeadingSd / noise, 2);
  while (part_s > kShortPart && MostLandmarks(options, *run.data, part_s) > kMaxPartLandmarks) {
    part_s = std::max(kShortPart, kShorter * std::min(part_s, DurationOf(*run.data)));
  }
  return part_s;
}

// Whether the first try at a run is by its parts.
bool GoesByParts(const ModeOptions& options, const MappingRun& run, double part_s) {
  constexpr double kParts = 1.5;
  const double duration = DurationOf(run);
  return duration >= kParts * part_s &&
         MostLandmarks(options, run, 2.0 * duration) > kManyLandmarks;
}

// Maps a run in parts, which are placed like runs.
BuildState MapByParts(const MapperOptions& options,
                      const BuildState& build,
                      const StepCallback& on_step,
                      double part_s,
                      BuildRun run) {
  RunParts parts(*run.data, part_s, BrokenMotions(run.motions));
  std::vector<RunMap> run_maps;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    BuildState part = MapPart(options, build, run, parts.At(k), on_step);
    if (on_step && !on_step(part)) break;
    if (std::optional<RunMap> run_map = MakeRunMap(options, std::move(part))) {
      run_maps.push_back(*std::move(run_map));
    }
  }
  BuildState placed = StartBuild(build.modes.size(), build.sensor);
  std::vector<RejectedRun> rejected;
  MapperOptions placing = options;
  placing.confirmation.enabled = false;  // Within a run landmarks stay.
  PlaceRunMaps(placing, std::nullopt, std::move(run_maps), &placed, &rejected, on_step);
  for (BuildRun& part : placed.runs) {
    parts.Place(static_cast<std::size_t>(part.data - &parts.At(0)), std::move(part.poses));
  }
  run.poses = parts.Poses(run.motions);
  return MapFromPoses(options, build, on_step, std::move(run));
}

// Maps a run from all its sightings.
BuildState MapSightings(const MappingRun& run,
                        std::size_t groups,
                        const MapperOptions& options,
                        const StepCallback& on_step) {
  BuildState nothing = StartBuild(groups, options.calibration.sensor);
  BuildRun build;
  build.data = &run;
  build.odometry = options.calibration.odometry;
  if (options.calibrate) CalibrateOpen(options, groups, on_step, &build, &nothing.sensor);
  UpdateMotions(run, build.odometry, &build.motions);
  const double part_s = PartDuration(options.modes, build);
  const bool by_parts = GoesByParts(options.modes, run, part_s);
  const auto map = [&](bool in_parts) {
    return in_parts ? MapByParts(options, nothing, on_step, part_s, build)
                    : MapByEkf(options, nothing, on_step, build);
  };
  BuildState first = map(by_parts);
  if (!IsInconsistent(first) || (on_step && !on_step(first))) return first;
  BuildState best = map(!by_parts);
  if (CostOf(first) <= CostOf(best)) best = std::move(first);
  while (IsInconsistent(best) && !(on_step && !on_step(best))) {
    const std::optional<FrameIndex> broken = FindBrokenMotion(best);
    if (!broken) break;
    BreakMotion(*broken, &build.motions);
    BuildState broken_up = map(true);
    if (CostOf(broken_up) >= CostOf(best)) break;
    best = std::move(broken_up);
  }
  return best;
}

bool IsImplausible(const MapperOptions& options, const BuildState& build) {
  return !ImplausibleCalibration(options.plausibility, build.runs.front(), build.sensor).empty();
}

// Puts a run in place of its part without unconfirmed visits (OnlySightings).
void AddUnconfirmed(const MappingRun& all,
                    const IndexedVector<VisitIndex, bool>& unconfirmed,
                    BuildState* build) {
  BuildRun& run = build->runs.front();
  run.data = &all;
  run.unconfirmed = unconfirmed;
  IndexedVector<VisitIndex, OptionalMode> assignment(all.visits.size(), kUnassigned);
  VisitIndex next(0);
  for (const VisitIndex v : all.visits.indices()) {
    if (!unconfirmed[v]) assignment[v] = run.assignment[next++];
  }
  run.assignment = std::move(assignment);
}

}  // namespace

void PullTogether(const MapperOptions& options, BuildState* build) {
  constexpr double kLossScales[] = {100.0, 15.0};  // [standard deviations]
  constexpr double kCostTolerance = 1e-3;          // The poses are those to solve on from.
  SolverLimits coarse = options.solver;
  coarse.cost_tolerance = std::max(kCostTolerance, coarse.cost_tolerance);
  Graph graph = MakeGraph(options, build);
  for (const double scale : kLossScales) {
    graph.loss_scale = scale;
    SolveGraph(coarse, &graph);
  }
  build->runs.front().poses = std::move(graph.runs.front().poses);
}

BuildState MapPart(const MapperOptions& options,
                   const BuildState& build,
                   const BuildRun& run,
                   const MappingRun& part,
                   const StepCallback& on_step) {
  BuildRun of_part;
  of_part.data = &part;
  of_part.odometry = run.odometry;
  of_part.sensor_bias = run.sensor_bias;
  of_part.motions = IntegrateMotions(part, run.odometry);
  return MapByEkf(options, build, on_step, std::move(of_part));
}

BuildState MapSingleRun(const MappingRun& run,
                        std::size_t groups,
                        const MapperOptions& options,
                        const StepCallback& on_step) {
  // What is confirmed leaves less uncertain, which may confirm more.
  constexpr int kRounds = 3;
  BuildState from_all = MapSightings(run, groups, options, on_step);
  const IndexedVector<SightingIndex, bool> trusted = TrustedSightings(options, from_all);
  const bool all = std::find(trusted.begin(), trusted.end(), false) == trusted.end();
  if (all || (on_step && !on_step(from_all))) return from_all;
  const MappingRun part = OnlySightings(run, trusted);
  BuildState mapped = MapSightings(part, groups, options, on_step);
  // The map of all sightings shows best why the run is implausible.
  if (IsImplausible(options, from_all) && IsImplausible(options, mapped)) return from_all;
  AddUnconfirmed(run, VisitsWithout(run, trusted), &mapped);
  for (int round = 0; round < kRounds && (!on_step || on_step(mapped)); ++round) {
    if (ConfirmVisits(options, &mapped) == 0) break;
    GraphSolver solver;
    AlternateModes(options, &mapped, &solver, on_step);
  }
  return mapped;
}

}  // namespace shiftmap
