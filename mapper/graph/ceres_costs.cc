// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/ceres_costs.h"

#include "mapper/graph/sensor_bias.h"

namespace shiftmap {
namespace {

using RowMajor3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
using RowMajor23 = Eigen::Matrix<double, 2, 3, Eigen::RowMajor>;
using RowMajor22 = Eigen::Matrix<double, 2, 2, Eigen::RowMajor>;

// Ceres' raw memory as a matrix that can be assigned to.
template <typename Matrix>
Eigen::Map<Matrix> As(double* data) {
  return Eigen::Map<Matrix>(data);
}

// d ξ / d (x, y, yaw).
Eigen::Matrix3d ToVehicleFrame(const Se2& T_map_vehicle) {
  Eigen::Matrix3d result = Eigen::Matrix3d::Identity();
  result.topLeftCorner<2, 2>() = T_map_vehicle.Rotation().transpose();
  return result;
}

}  // namespace

bool MotionCost::Evaluate(double const* const* parameters,
                          double* residuals,
                          double** jacobians) const {
  const Se2 T_map_i = PoseFromParameters(parameters[0]);
  const Se2 T_map_j = PoseFromParameters(parameters[1]);
  const MotionResidual::Linear linear =
      residual_.At(T_map_i,
                   T_map_j,
                   Eigen::Map<const Eigen::Vector3d>(parameters[2]),
                   parameters[3][kLogRangeScale]);
  As<Eigen::Vector3d>(residuals) = linear.r;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) As<RowMajor3>(jacobians[0]) = linear.J_i * ToVehicleFrame(T_map_i);
  if (jacobians[1] != nullptr) As<RowMajor3>(jacobians[1]) = linear.J_j * ToVehicleFrame(T_map_j);
  if (jacobians[2] != nullptr) As<RowMajor3>(jacobians[2]) = linear.J_calibration.leftCols<3>();
  if (jacobians[3] != nullptr) {
    As<RowMajor3>(jacobians[3]).setZero();
    As<RowMajor3>(jacobians[3]).col(kLogRangeScale) = linear.J_calibration.col(3);
  }
  return true;
}

bool ObservationCost::Evaluate(double const* const* parameters,
                               double* residuals,
                               double** jacobians) const {
  const Se2 T_map_vehicle = PoseFromParameters(parameters[0]);
  const ObservationResidual::Linear linear =
      residual_.At(T_map_vehicle,
                   Eigen::Map<const Eigen::Vector2d>(parameters[1]),
                   Eigen::Map<const SensorBias>(parameters[2]));
  As<Eigen::Vector2d>(residuals) = linear.r;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr)
    As<RowMajor23>(jacobians[0]) = linear.J_pose * ToVehicleFrame(T_map_vehicle);
  if (jacobians[1] != nullptr) As<RowMajor22>(jacobians[1]) = linear.J_landmark;
  if (jacobians[2] != nullptr) As<RowMajor23>(jacobians[2]) = linear.J_bias;
  return true;
}

}  // namespace shiftmap
