// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/graph_step.h"

#include <cstddef>

namespace shiftmap {

GraphStep Scaled(GraphStep step, double factor) {
  for (Eigen::VectorXd& poses : step.poses) poses *= factor;
  for (auto& calibration : step.calibrations) calibration *= factor;
  step.modes *= factor;
  return step;
}

void Apply(const GraphStep& step, Graph* graph) {
  for (std::size_t r = 0; r < graph->runs.size(); ++r) {
    GraphRun& run = graph->runs[r];
    for (std::size_t i = 0; i < run.poses.size(); ++i) {
      run.poses[i] =
          run.poses[i] * Se2::Exp(step.poses[r].segment<3>(static_cast<Eigen::Index>(3 * i)));
    }
    run.correction += step.calibrations[r].head<3>();
    run.sensor_bias += step.calibrations[r].tail<3>();
  }
  for (std::size_t m = 0; m < graph->modes.size(); ++m) {
    graph->modes[m] += step.modes.segment<2>(static_cast<Eigen::Index>(2 * m));
  }
}

}  // namespace shiftmap
