// SPDX-License-Identifier: Apache-2.0
#include "tests/unit/tools/experiment/incremental/small_site.h"

#include <cmath>
#include <random>

namespace shiftmap::testing {
namespace {

constexpr double kHeldSd = 1e-9;
constexpr double kSurveySd = 0.05;

MotionIncrement StepOfCircle() {
  MotionIncrement motion;
  motion.T_begin_end = Se2::Exp({0.25, 0.0, 0.0625});
  motion.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal();
  motion.J_calibration << 0.25, 0.0, 0.01, 0.0, 0.0, 0.002, 0.0, 0.0625, 0.001;
  return motion;
}

}  // namespace

Graph MakeSmallSite(const SiteShape& shape, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const auto draw = [&](double sd) { return shape.noise * sd * normal(random); };
  Graph graph;
  graph.loss_scale = kNoLoss;
  IndexedVector<ModeIndex, Eigen::Vector2d> places;
  for (int m = 0; m < shape.modes; ++m) {
    const double angle = 2.0 * M_PI * m / shape.modes;
    places.emplace_back(6.0 * std::cos(angle), 6.0 * std::sin(angle));
    graph.modes.emplace_back(places.back() + Eigen::Vector2d(draw(kSurveySd), draw(kSurveySd)));
  }
  GraphRun run;
  run.correction_prior_sd.setConstant(shape.calibrated ? kHeldSd : 0.05);
  run.sensor_bias_sd =
      shape.calibrated ? SensorBias::Constant(kHeldSd) : SensorBias(0.01, 0.02, 0.1);
  Se2 truth(4.0, 0.0, M_PI / 2.0);
  for (int i = 0; i < shape.frames; ++i) {
    if (i > 0) {
      MotionIncrement motion = StepOfCircle();
      truth = truth * motion.T_begin_end * Se2::Exp({draw(0.01), draw(0.01), draw(0.003)});
      run.poses.push_back(run.poses.back() * motion.T_begin_end);
      run.motions.push_back(motion);
    } else {
      run.poses.push_back(truth);
    }
    for (const ModeIndex m : places.indices()) {
      const Eigen::Vector2d q = truth.Inverse() * places[m];
      if (q.norm() > 5.0) continue;
      GraphObservation item;
      item.frame = FrameIndex(i);
      item.mode = m;
      item.cov_z = Eigen::Vector2d(0.01, 1e-4).asDiagonal();
      item.observation.z = {q.norm() + draw(0.1), std::atan2(q.y(), q.x()) + draw(0.01)};
      graph.observations.push_back(item);
    }
  }
  graph.runs.push_back(run);
  if (shape.surveyed) {
    std::vector<ModeIndex> modes;
    Eigen::VectorXd mean(2 * shape.modes);
    for (const ModeIndex m : graph.modes.indices()) {
      modes.push_back(m);
      mean.segment<2>(2 * m) = graph.modes[m];
    }
    graph.priors.emplace_back(
        std::move(modes),
        std::move(mean),
        Eigen::MatrixXd::Identity(2 * shape.modes, 2 * shape.modes) / kSurveySd);
  }
  return graph;
}

PoseWithCovariance StartOf(const SiteShape& shape, const Graph& graph) {
  return {graph.runs[0].poses[0], Eigen::Matrix3d::Identity() * (shape.start_sd * shape.start_sd)};
}

SmootherOptions OptionsOf(const Graph& graph) {
  SmootherOptions options;
  options.calibration_sd << graph.runs[0].correction_prior_sd, graph.runs[0].sensor_bias_sd;
  options.loss_scale = graph.loss_scale;
  return options;
}

void AddModes(const Graph& graph, FixedLagSmoother* smoother) {
  for (const Eigen::Vector2d& mode : graph.modes) {
    smoother->AddMode(mode, Eigen::Matrix2d::Identity());
  }
  if (!graph.priors.empty()) smoother->SetPrior(graph.priors.front());
}

void AddNextFrame(const Graph& graph, int frame, FixedLagSmoother* smoother) {
  if (frame == 0) {
    smoother->AddFrame();
  } else {
    smoother->AddFrame(graph.runs[0].motions[FrameIndex(frame - 1)]);
  }
  for (const GraphObservation& item : graph.observations) {
    if (item.frame != FrameIndex(frame)) continue;
    const int mode = item.mode.value();
    smoother->AddObservation({mode, 0, mode, item, Eigen::Matrix2d::Identity()});
  }
}

}  // namespace shiftmap::testing
