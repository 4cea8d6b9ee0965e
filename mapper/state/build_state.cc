// SPDX-License-Identifier: Apache-2.0
#include "mapper/state/build_state.h"

#include <algorithm>
#include <cmath>

#include "mapper/covariance/map_prior.h"

namespace shiftmap {
namespace {

// Of what is not estimated.
constexpr double kHeldSd = 1e-9;

// @param tells_scale  As TellsScales().
GraphRun MakeGraphRun(const MapperOptions& options, bool tells_scale, BuildRun* run) {
  const OdometryCalibration& fleet = options.calibration.odometry;
  const bool calibrate = options.calibrate;
  UpdateMotions(*run->data, run->odometry, &run->motions);
  GraphRun result;
  result.poses = run->poses;
  result.variance_factor = run->variance_factor;
  for (const IntegratedMotion& motion : run->motions.between_frames) {
    result.motions.push_back(motion.WithNoise(run->odometry.noise_v, run->odometry.noise_omega));
  }
  const double sd_scale = calibrate ? fleet.sd_log_scale : kHeldSd;
  result.correction = CorrectionBetween(run->motions.calibration, run->odometry);
  result.correction_prior_sd = {sd_scale, sd_scale, calibrate ? kLagSd : kHeldSd};
  result.correction_prior_mean = CorrectionBetween(run->motions.calibration, fleet);
  result.sensor_bias = run->sensor_bias;
  result.sensor_bias_sd.setConstant(kHeldSd);
  if (calibrate) {
    result.sensor_bias_sd.tail<2>() << options.sd_bearing_offset_rad,
        options.sd_range_curvature_per_rad2;
  }
  if (calibrate && tells_scale) {
    result.sensor_bias_sd[kLogRangeScale] = std::max(kHeldSd, options.sd_run_range_scale);
  }
  return result;
}

void CopyBack(const Graph& graph, BuildState* build) {
  ModeIndex flat;
  for (GroupModes& group : build->modes) {
    for (BuildMode& mode : group) mode.p_map_landmark = graph.modes[flat++];
  }
  for (const RunIndex r : build->runs.indices()) {
    BuildRun& run = build->runs[r];
    run.poses = graph.runs[r].poses;
    const Eigen::Vector3d& correction = graph.runs[r].correction;
    run.odometry.scale_v = run.motions.calibration.scale_v * std::exp(correction.x());
    run.odometry.scale_omega = run.motions.calibration.scale_omega * std::exp(correction.y());
    run.odometry.lag_s = run.motions.calibration.lag_s + correction.z();
    run.sensor_bias = graph.runs[r].sensor_bias;
  }
}

}  // namespace

std::vector<BuildModeRef> ModesOf(const BuildRun& run) {
  std::vector<BuildModeRef> modes;
  for (const VisitIndex v : run.assignment.indices()) {
    if (run.assignment[v]) modes.push_back({run.data->visits[v].group, *run.assignment[v]});
  }
  std::sort(modes.begin(), modes.end());
  modes.erase(std::unique(modes.begin(), modes.end()), modes.end());
  return modes;
}

FlatModes::FlatModes(const BuildState& build) {
  for (const GroupModes& group : build.modes) {
    first.push_back(end);
    end = end + static_cast<int>(group.size());
  }
}

std::vector<ModeIndex> FlatModes::Of(const BuildRun& run) const {
  std::vector<ModeIndex> modes;
  for (const auto& [group, mode] : ModesOf(run)) modes.push_back(Index(group, mode));
  return modes;
}

IndexedVector<ModeIndex, Eigen::Vector2d> ModePositions(const BuildState& build) {
  IndexedVector<ModeIndex, Eigen::Vector2d> positions;
  for (const GroupModes& group : build.modes) {
    for (const BuildMode& mode : group) positions.push_back(mode.p_map_landmark);
  }
  return positions;
}

std::map<std::string, std::vector<RunIndex>> RunsByVehicle(const BuildState& build) {
  std::map<std::string, std::vector<RunIndex>> runs;
  for (const RunIndex r : build.runs.indices()) {
    runs[build.runs[r].data->info.vehicle].push_back(r);
  }
  return runs;
}

bool TellsScales(const BuildState& build) {
  return build.in_map_units ||
         std::any_of(build.runs.begin(), build.runs.end(), [&](const BuildRun& run) {
           return run.data->info.vehicle != build.runs.front().data->info.vehicle;
         });
}

void MoveBuild(const Se2& T_map_old, BuildState* build) {
  for (BuildRun& run : build->runs) {
    for (Se2& pose : run.poses) pose = T_map_old * pose;
  }
  for (GroupModes& group : build->modes) {
    for (BuildMode& mode : group) {
      mode.p_map_landmark = T_map_old * mode.p_map_landmark;
      if (mode.displaced_to) mode.displaced_to = T_map_old * *mode.displaced_to;
    }
  }
  for (KeptAlternatives& kept : build->kept) {
    for (KeptAlternatives::Doubt& doubt : kept.doubts) doubt.place = T_map_old * doubt.place;
  }
  const Eigen::Matrix2d R_map_old = T_map_old.Rotation();
  for (Eigen::Index row = 0; row < build->distortion_root.rows(); row += 2) {
    build->distortion_root.middleRows<2>(row) =
        (R_map_old * build->distortion_root.middleRows<2>(row)).eval();
  }
  for (auto& [mode, of_mode] : build->disagreement.of_modes) {
    of_mode = R_map_old * of_mode.eval() * R_map_old.transpose();
  }
}

BuildState StartBuild(std::size_t groups, const SensorCalibration& sensor) {
  BuildState build;
  build.sensor = sensor;
  build.modes.resize(groups);
  return build;
}

BuildState StartBuild(const std::vector<Signature>& signatures,
                      const MapContent& prior,
                      const SensorCalibration& sensor) {
  BuildState build = StartBuild(signatures.size(), sensor);
  build.known.resize(signatures.size());
  build.known_at = prior.stamp;
  for (const LandmarkGroup& group : prior.groups) {
    const GroupIndex g(std::lower_bound(signatures.begin(), signatures.end(), group.signature) -
                       signatures.begin());
    for (const Mode& mode : group.modes) {
      build.modes[g].push_back({mode.p_map_landmark, mode.number});
    }
    build.known[g] = group;
  }
  const IndexedVector<ModeIndex, Eigen::Vector2d> positions = ModePositions(build);
  build.in_map_units = positions.size() > 1;  // One position has no length.
  build.priors = MakeMapPrior(positions, prior.covariance);
  return build;
}

GroupModeIndex AddMode(GroupIndex group, const BuildMode& mode, BuildState* build) {
  GroupModes& modes = build->modes[group];
  const GroupModeIndex index = modes.end_index();
  if (!build->priors.empty()) {
    ShiftPriors(FlatModes(*build).Index(group, index), 1, &build->priors);
  }
  modes.push_back(mode);
  return index;
}

void ShiftPriors(ModeIndex first, int shift, std::vector<GraphPrior>* priors) {
  for (GraphPrior& prior : *priors) {
    for (ModeIndex& mode : prior.modes) mode = mode >= first ? mode + shift : mode;
  }
}

Graph MakeGraph(const MapperOptions& options, BuildState* build) {
  Graph graph;
  const FlatModes flat(*build);
  graph.modes = ModePositions(*build);
  const bool tells_scale = TellsScales(*build);
  for (const RunIndex r : build->runs.indices()) {
    BuildRun& run = build->runs[r];
    graph.runs.push_back(MakeGraphRun(options, tells_scale, &run));
    for (const Sighting& sighting : run.data->sightings) {
      const OptionalMode mode = run.assignment[sighting.visit];
      if (!mode) continue;
      const GroupIndex group = run.data->visits[sighting.visit].group;
      graph.observations.push_back({r,
                                    sighting.frame,
                                    flat.Index(group, *mode),
                                    run.distortion.Undistorted(sighting.observation),
                                    ObservationNoise(sighting.observation, build->sensor),
                                    run.data->mean_squared_bearing});
    }
  }
  graph.priors = build->priors;
  graph.open = build->open;
  graph.loss_reach = build->loss_reach;
  graph.solver = options.solver_kind;
  // Runs by themselves are mapped side by side.
  graph.threads = build->runs.size() > 1 ? options.threads : 1;
  return graph;
}

Graph SolveOnce(const MapperOptions& options, BuildState* build, GraphSolver* solver) {
  Graph graph = MakeGraph(options, build);
  build->cost = solver->Solve(options.solver, &graph).final_cost;
  CopyBack(graph, build);
  return graph;
}

Graph SolveContinuous(const MapperOptions& options, BuildState* build) {
  GraphSolver solver;
  return SolveContinuous(options, build, &solver);
}

Graph SolveContinuous(const MapperOptions& options, BuildState* build, GraphSolver* solver) {
  // Integrate again until the calibration stays.
  Graph graph;
  for (int i = 0; i < options.max_integrations; ++i) {
    graph = SolveOnce(options, build, solver);
    const bool settled = std::all_of(graph.runs.begin(), graph.runs.end(), [](const GraphRun& run) {
      return run.correction.cwiseAbs().maxCoeff() < kLinearCorrection;
    });
    if (settled) break;
  }
  return graph;
}

}  // namespace shiftmap
