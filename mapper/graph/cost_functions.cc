// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/cost_functions.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include "mapper/graph/sensor_bias.h"

namespace shiftmap {
namespace {

// Below this a motion is as good as certain, and the square root would blow up. [m], [rad]
constexpr double kMinMotionSd = 1e-4;

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

template <typename Matrix>
Matrix SqrtInformation(const Matrix& cov) {
  const Eigen::LLT<Matrix> llt(cov);
  return llt.matrixL().solve(Matrix::Identity());
}

template Eigen::Matrix2d SqrtInformation(const Eigen::Matrix2d& cov);
template Eigen::Matrix3d SqrtInformation(const Eigen::Matrix3d& cov);

MotionCost::MotionCost(const MotionIncrement& motion)
    : T_i_j_(motion.T_begin_end), J_calibration_(motion.J_calibration) {
  const Eigen::Matrix3d floor = Eigen::Matrix3d::Identity() * (kMinMotionSd * kMinMotionSd);
  sqrt_information_ = SqrtInformation<Eigen::Matrix3d>(motion.cov + floor);
}

bool MotionCost::Evaluate(double const* const* parameters,
                          double* residuals,
                          double** jacobians) const {
  const Se2 T_map_i = PoseFromParameters(parameters[0]);
  const Se2 T_map_j = PoseFromParameters(parameters[1]);
  const Eigen::Map<const Eigen::Vector3d> correction(parameters[2]);
  const Eigen::Vector3d shift = J_calibration_ * correction;
  const Se2 T_i_j = T_map_i.Inverse() * T_map_j;
  const Se2 error = (T_i_j_ * Se2::Exp(shift)).Inverse() * T_i_j;
  const Eigen::Vector3d r = error.Log();
  As<Eigen::Vector3d>(residuals) = sqrt_information_ * r;
  if (jacobians == nullptr) return true;

  const Eigen::Matrix3d whitened = sqrt_information_ * Se2::RightJacobian(r).inverse();
  if (jacobians[0] != nullptr) {
    As<RowMajor3>(jacobians[0]) = -whitened * T_i_j.Inverse().Adjoint() * ToVehicleFrame(T_map_i);
  }
  if (jacobians[1] != nullptr) {
    As<RowMajor3>(jacobians[1]) = whitened * ToVehicleFrame(T_map_j);
  }
  if (jacobians[2] != nullptr) {
    As<RowMajor3>(jacobians[2]) =
        -whitened * error.Inverse().Adjoint() * Se2::RightJacobian(shift) * J_calibration_;
  }
  return true;
}

ObservationCost::ObservationCost(const GraphObservation& observation)
    : observation_(observation), sqrt_information_(SqrtInformation(observation.cov_z)) {}

bool ObservationCost::Evaluate(double const* const* parameters,
                               double* residuals,
                               double** jacobians) const {
  const Se2 T_map_vehicle = PoseFromParameters(parameters[0]);
  const Eigen::Map<const Eigen::Vector2d> p_map_landmark(parameters[1]);
  const Eigen::Map<const SensorBias> bias(parameters[2]);
  Eigen::Matrix2d J_bias;
  const Innovation innovation = LinearizeBiased(observation_.observation,
                                                T_map_vehicle,
                                                p_map_landmark,
                                                bias,
                                                observation_.mean_squared_bearing,
                                                &J_bias);
  As<Eigen::Vector2d>(residuals) = sqrt_information_ * innovation.nu;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    As<RowMajor23>(jacobians[0]) =
        -sqrt_information_ * innovation.H_pose * ToVehicleFrame(T_map_vehicle);
  }
  if (jacobians[1] != nullptr)
    As<RowMajor22>(jacobians[1]) = -sqrt_information_ * innovation.H_landmark;
  if (jacobians[2] != nullptr) As<RowMajor22>(jacobians[2]) = -sqrt_information_ * J_bias;
  return true;
}

}  // namespace shiftmap
