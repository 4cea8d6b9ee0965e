// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/graph_step.h"

namespace shiftmap {

GraphStep Scaled(GraphStep step, double factor) {
  for (Eigen::VectorXd& poses : step.poses) poses *= factor;
  for (GraphStep::Calibration& calibration : step.calibrations) calibration *= factor;
  step.modes *= factor;
  return step;
}

void Apply(const GraphStep& step, Graph* graph) {
  for (const RunIndex r : graph->runs.indices()) {
    GraphRun& run = graph->runs[r];
    for (const FrameIndex i : run.poses.indices()) {
      run.poses[i] = run.poses[i] * Se2::Exp(step.poses[r].segment<3>(3 * i));
    }
    run.correction += step.calibrations[r].head<3>();
    run.sensor_bias += step.calibrations[r].tail<3>();
  }
  for (const ModeIndex m : graph->modes.indices()) graph->modes[m] += step.modes.segment<2>(2 * m);
}

}  // namespace shiftmap
