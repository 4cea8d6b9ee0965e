// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// A change of everything continuous in a graph.
struct GraphStep {
  std::vector<Eigen::VectorXd> poses;  ///< Per run ξ of every pose, T·Exp(ξ), three rows each.
  std::vector<Eigen::Vector<double, kRunCalibration>> calibrations;  ///< Per run, correction first.
  Eigen::VectorXd modes;                                             ///< (x, y) each. [m]
};

/// A step `factor` times as long.
GraphStep Scaled(GraphStep step, double factor);

/// Moves a graph's values along a step.
void Apply(const GraphStep& step, Graph* graph);

}  // namespace shiftmap
