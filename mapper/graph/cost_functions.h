// SPDX-License-Identifier: Apache-2.0
//
// Residuals of the graph with analytic Jacobians. Poses are parameter blocks (x, y, yaw) in the map
// frame: adding to them is a perturbation R_map_vehicle ξ_xy, ξ_yaw, so that dr/d(x, y, yaw) =
// dr/dξ · diag(R_map_vehicleᵀ, 1).
#pragma once

#include <ceres/sized_cost_function.h>

#include <Eigen/Core>

#include "localizer/models/motion_model.h"
#include "mapper/graph/graph.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// r = Σ^(-1/2) Log( (T_i Δ(c))⁻¹ T_j ),  Δ(c) = Δ Exp(J c).
/// Parameter blocks: pose i (3), pose j (3), calibration correction c (3).
class MotionCost final : public ceres::SizedCostFunction<3, 3, 3, 3> {
 public:
  explicit MotionCost(const MotionIncrement& motion);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  Se2 T_i_j_;
  Eigen::Matrix3d J_calibration_;
  Eigen::Matrix3d sqrt_information_;
};

/// r = R^(-1/2) (z - h(T, p, b)), bearing wrapped.
/// Parameter blocks: pose (3), landmark (2), sensor bias b (2).
class ObservationCost final : public ceres::SizedCostFunction<2, 3, 2, 2> {
 public:
  /// @param observation  Must outlive the cost.
  explicit ObservationCost(const GraphObservation& observation);
  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  const GraphObservation& observation_;
  Eigen::Matrix2d sqrt_information_;
};

/// The pose block of a parameter array.
inline Se2 PoseFromParameters(const double* parameters) {
  return Se2(parameters[0], parameters[1], parameters[2]);
}

/// The inverse of the Cholesky factor: its product with a vector of covariance `cov` has unit
/// covariance.
template <typename Matrix>
Matrix SqrtInformation(const Matrix& cov);

}  // namespace shiftmap
