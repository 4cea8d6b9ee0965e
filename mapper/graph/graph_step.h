// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/graph/graph.h"

namespace shiftmap {

/// A change of everything continuous in a graph.
struct GraphStep {
  using Calibration = Eigen::Vector<double, kRunCalibration>;  ///< Correction first.

  IndexedVector<RunIndex, Eigen::VectorXd> poses;  ///< ξ of every pose, T·Exp(ξ), three rows each.
  IndexedVector<RunIndex, Calibration> calibrations;
  Eigen::VectorXd modes;  ///< (x, y) each. [m]
};

/// A step `factor` times as long.
GraphStep Scaled(GraphStep step, double factor);

/// Moves a graph's values along a step.
void Apply(const GraphStep& step, Graph* graph);

}  // namespace shiftmap
