// SPDX-License-Identifier: Apache-2.0
//
// The residuals of the graph as Ceres takes them. Poses are parameter blocks (x, y, yaw) in the map
// frame: adding to them is a perturbation R_map_vehicle ξ_xy, ξ_yaw, so that dr/d(x, y, yaw) =
// dr/dξ · diag(R_map_vehicleᵀ, 1).
#pragma once

#include <ceres/sized_cost_function.h>

#include "mapper/graph/residuals.h"

namespace shiftmap {

/// MotionResidual. Parameter blocks: pose i (3), pose j (3), calibration correction c (3), sensor
/// bias b (3).
class MotionCost final : public ceres::SizedCostFunction<3, 3, 3, 3, 3> {
 public:
  MotionCost(const MotionIncrement& motion, double variance_factor)
      : residual_(motion, variance_factor) {}
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  MotionResidual residual_;
};

/// ObservationResidual. Parameter blocks: pose (3), landmark (2), sensor bias b (3).
class ObservationCost final : public ceres::SizedCostFunction<2, 3, 2, 3> {
 public:
  /// @param observation  Must outlive the cost.
  explicit ObservationCost(const GraphObservation& observation) : residual_(observation) {}
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  ObservationResidual residual_;
};

/// The pose block of a parameter array.
inline Se2 PoseFromParameters(const double* parameters) {
  return Se2(parameters[0], parameters[1], parameters[2]);
}

}  // namespace shiftmap
