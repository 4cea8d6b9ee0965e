// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_static.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "localizer/models/observation_model.h"
#include "mapper/covariance/gauge.h"
#include "mapper/frontend/ekf_slam.h"
#include "mapper/graph/graph.h"
#include "mapstore/core/median.h"

namespace shiftmap {
namespace {

constexpr int kSolverIterations = 50;

// Reweightings of the map's places, each with a solve that starts from the last.
constexpr int kReweightings = 30;
constexpr double kSettledM = 1e-3;

// Distance from the map at which Cauchy's loss turns from square to logarithm, in standard
// deviations: 95 % efficient on Gaussian errors.
constexpr double kCauchyScale = 2.385;

// Of what the graph could also estimate and is known here.
constexpr double kHeldSd = 1e-9;

constexpr double kOdometryPeriodSeconds = 0.02;  // IJRR 8.2.1.

Graph StaticGraph(const UtiasCase& data,
                  const UtiasNoise& noise,
                  const LandmarkPlaces& map,
                  double prior_sd_m) {
  Graph graph;
  graph.loss_scale = noise.loss_scale;
  GraphRun run;
  run.poses = StartPoses(data, noise, map);
  run.motions = UtiasMotions(data, noise);
  run.correction_prior_sd.setConstant(kHeldSd);
  run.sensor_bias_sd.setConstant(kHeldSd);
  graph.runs.push_back(std::move(run));
  const auto observations = UtiasObservations(data, noise);
  for (const SightingIndex i : observations.indices()) {
    const Sighting& sighting = data.frames.sightings[i];
    graph.observations.push_back({0,
                                  sighting.frame,
                                  ModeIndex(data.frames.visits[sighting.visit].group.value()),
                                  observations[i],
                                  ObservationNoise(observations[i], noise.sensor),
                                  0.0});
  }
  std::vector<ModeIndex> modes;
  for (const auto& [signature, place] : map) {
    modes.push_back(graph.modes.end_index());
    graph.modes.push_back(place);
  }
  graph.priors = HoldModes(modes, graph.modes, prior_sd_m);
  return graph;
}

// Weights of Cauchy's loss at the present distances: w = 1 / (1 + (d / c sd)²).
void Reweight(double prior_sd_m, Graph* graph) {
  for (GraphPrior& prior : graph->priors) {
    const Eigen::Vector2d& place = graph->modes[prior.modes.front()];
    const double ratio = (place - prior.mean).norm() / (kCauchyScale * prior_sd_m);
    const double sd_m = prior_sd_m * std::sqrt(1.0 + ratio * ratio);
    prior = {prior.modes, prior.mean, Eigen::MatrixXd(Eigen::Matrix2d::Identity() / sd_m)};
  }
}

// Iteratively reweighted least squares: the fixed point is a minimum of the robust cost.
void SolveReweighted(double prior_sd_m, Graph* graph) {
  for (int i = 0; i < kReweightings; ++i) {
    const IndexedVector<ModeIndex, Eigen::Vector2d> before = graph->modes;
    Reweight(prior_sd_m, graph);
    SolveGraph({kSolverIterations}, graph);
    double moved = 0.0;
    for (const ModeIndex k : before.indices()) {
      moved = std::max(moved, (graph->modes[k] - before[k]).norm());
    }
    if (moved < kSettledM) return;
  }
}

}  // namespace

UtiasNoise CalibratedNoise(const MapperResult& without_map) {
  UtiasNoise noise;
  noise.odometry = without_map.runs.front().odometry;
  const OdometryCalibration& fleet = without_map.content.calibration.odometry;
  noise.odometry.noise_v = fleet.noise_v;
  noise.odometry.noise_omega = fleet.noise_omega;
  noise.sensor = without_map.content.calibration.sensor;
  noise.bias = without_map.runs.front().sensor_bias;
  return noise;
}

UtiasNoise PrintedNoise(int dataset) {
  UtiasNoise noise;
  noise.sensor.sd_range_m = 0.2;
  noise.sensor.sd_bearing_rad = 0.11;
  noise.printed_process_sd = dataset == 2 ? 0.03 : 0.01;
  noise.loss_scale = 1e6;
  return noise;
}

IndexedVector<FrameIndex, MotionIncrement> UtiasMotions(const UtiasCase& data,
                                                        const UtiasNoise& noise) {
  const FrameMotions integrated = IntegrateMotions(data.frames, noise.odometry);
  IndexedVector<FrameIndex, MotionIncrement> motions;
  const auto& frames = data.frames.frames;
  for (FrameIndex i; i + 1 < frames.end_index(); ++i) {
    MotionIncrement motion = MotionFrom(integrated, i, noise.odometry);
    if (noise.printed_process_sd) {
      const double samples =
          ToSeconds(frames[i + 1].stamp - frames[i].stamp) / kOdometryPeriodSeconds;
      const double sd = kOdometryPeriodSeconds * *noise.printed_process_sd;
      motion.cov = Eigen::Matrix3d::Identity() * (std::max(1.0, samples) * sd * sd);
    }
    motions.push_back(std::move(motion));
  }
  return motions;
}

IndexedVector<SightingIndex, Observation> UtiasObservations(const UtiasCase& data,
                                                            const UtiasNoise& noise) {
  IndexedVector<SightingIndex, Observation> observations;
  for (const Sighting& sighting : data.frames.sightings) {
    observations.push_back(
        Unbiased(sighting.observation, noise.bias, data.frames.mean_squared_bearing));
  }
  return observations;
}

std::vector<Se2> StartPoses(const UtiasCase& data,
                            const UtiasNoise& noise,
                            const LandmarkPlaces& map) {
  IndexedVector<FrameIndex, Se2> poses = EstimateTrajectoryByEkf(
      data.frames,
      IntegrateMotions(data.frames, noise.odometry),
      {noise.odometry, WithBias(noise.sensor, noise.bias, data.frames.mean_squared_bearing)});
  IndexedVector<GroupIndex, std::vector<double>> x(data.signatures.size());
  IndexedVector<GroupIndex, std::vector<double>> y(data.signatures.size());
  for (const Sighting& sighting : data.frames.sightings) {
    const GroupIndex group = data.frames.visits[sighting.visit].group;
    const Eigen::Vector2d p_start_landmark =
        LandmarkPosition(sighting.observation, poses[sighting.frame]);
    x[group].push_back(p_start_landmark.x());
    y[group].push_back(p_start_landmark.y());
  }
  std::vector<PointPair> pairs;
  for (const GroupIndex group : data.signatures.indices()) {
    if (x[group].empty()) continue;
    pairs.push_back({map.at(data.signatures[group]), {Median(x[group]), Median(y[group])}});
  }
  const StatusOr<Se2> T_map_start = AlignRigid2d(pairs);
  if (!T_map_start.ok()) return poses;
  for (Se2& pose : poses) pose = *T_map_start * pose;
  return poses;
}

UtiasEstimate SolveStatic(const UtiasCase& data,
                          const UtiasNoise& noise,
                          const LandmarkPlaces& map,
                          double prior_sd_m,
                          StaticLoss loss) {
  Graph graph = StaticGraph(data, noise, map, prior_sd_m);
  if (loss == StaticLoss::kCauchy) {
    SolveReweighted(prior_sd_m, &graph);
  } else {
    SolveGraph({kSolverIterations}, &graph);
  }
  UtiasEstimate estimate;
  estimate.poses = graph.runs.front().poses;
  for (const Eigen::Vector2d& mode : graph.modes) estimate.modes.push_back({mode});
  estimate.sighting_modes.assign(data.frames.sightings.size(), 0);
  return estimate;
}

}  // namespace shiftmap
