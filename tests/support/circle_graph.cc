// SPDX-License-Identifier: Apache-2.0
#include "tests/support/circle_graph.h"

#include <cmath>
#include <random>
#include <utility>
#include <vector>

namespace shiftmap::testing {

Graph MakeCircleGraph(const CircleShape& shape, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Graph graph;
  for (int m = 0; m < shape.modes; ++m) {
    const double angle = 2.0 * M_PI * m / shape.modes;
    graph.modes.emplace_back(6.0 * std::cos(angle), 6.0 * std::sin(angle));
  }
  for (int r = 0; r < shape.runs; ++r) {
    GraphRun run;
    run.correction_prior_sd = Eigen::Vector3d(0.1, 0.1, 0.1);
    run.sensor_bias_sd = SensorBias(0.02, 0.05, 0.1);
    Se2 truth(4.0, 0.3 * r, M_PI / 2.0);
    for (int i = 0; i < shape.frames; ++i) {
      if (i > 0) {
        MotionIncrement motion;
        motion.T_begin_end = Se2::Exp({0.25, 0.0, 0.0625});
        motion.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal();
        motion.J_calibration << 0.25, 0.0, 0.01, 0.0, 0.0, 0.002, 0.0, 0.0625, 0.001;
        truth = truth * motion.T_begin_end *
                Se2::Exp({0.01 * normal(random), 0.01 * normal(random), 0.003 * normal(random)});
        run.motions.push_back(motion);
      }
      run.poses.push_back(truth * Se2::Exp(shape.disturbance *
                                           Eigen::Vector3d(normal(random), normal(random), 0.2)));
      for (const ModeIndex m : graph.modes.indices()) {
        const Eigen::Vector2d q = truth.Inverse() * graph.modes[m];
        if (q.norm() > 5.0) continue;
        GraphObservation item;
        item.run = RunIndex(r);
        item.frame = FrameIndex(i);
        item.mode = m;
        item.cov_z = Eigen::Vector2d(0.01, 1e-4).asDiagonal();
        item.observation.z = {q.norm() + 0.1 * normal(random),
                              std::atan2(q.y(), q.x()) + 0.01 * normal(random)};
        graph.observations.push_back(item);
      }
    }
    graph.runs.push_back(std::move(run));
  }
  for (Eigen::Vector2d& mode : graph.modes) {
    mode += shape.disturbance * Eigen::Vector2d(normal(random), normal(random));
  }
  return graph;
}

GraphPrior MakeModesPrior(const Graph& graph) {
  const Eigen::Index size = 2 * graph.modes.end_index();
  std::vector<ModeIndex> modes;
  Eigen::VectorXd mean(size);
  for (const ModeIndex m : graph.modes.indices()) {
    modes.push_back(m);
    mean.segment<2>(2 * m) = graph.modes[m];
  }
  return {std::move(modes), std::move(mean), Eigen::MatrixXd::Identity(size, size) * 20.0};
}

}  // namespace shiftmap::testing
