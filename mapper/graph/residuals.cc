// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/residuals.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "mapper/graph/sensor_bias.h"

namespace shiftmap {
namespace {

// Below this a motion is as good as certain, and the square root would blow up. [m], [rad]
constexpr double kMinMotionSd = 1e-4;

// The inverse of the Cholesky factor: its product with a vector of covariance `cov` has unit
// covariance.
template <typename Matrix>
Matrix SqrtInformation(const Matrix& cov) {
  const Eigen::LLT<Matrix> llt(cov);
  return llt.matrixL().solve(Matrix::Identity());
}

}  // namespace

MotionResidual::MotionResidual(const MotionIncrement& motion)
    : T_i_j_(motion.T_begin_end), R_i_j_(T_i_j_.Rotation()), J_calibration_(motion.J_calibration) {
  const Eigen::Matrix3d floor = Eigen::Matrix3d::Identity() * (kMinMotionSd * kMinMotionSd);
  sqrt_information_ = SqrtInformation<Eigen::Matrix3d>(motion.cov + floor);
}

MotionResidual::Linear MotionResidual::At(const Se2& T_map_i,
                                          const Se2& T_map_j,
                                          const Eigen::Vector3d& correction,
                                          double log_range_scale) const {
  // Rotations are chained as matrices: one sine and cosine for all of them.
  const Se2::Step shift = Se2::ExpStep(J_calibration_ * correction);
  const Eigen::Matrix2d R_i_odometry =
      R_i_j_ * shift.inverse_adjoint.topLeftCorner<2, 2>().transpose();
  const Eigen::Vector2d p_i_odometry = T_i_j_.translation() + R_i_j_ * shift.T.translation();
  const Eigen::Vector2d p_i_j =
      T_map_i.Rotation().transpose() * (T_map_j.translation() - T_map_i.translation());
  const double yaw_i_j = T_map_j.yaw() - T_map_i.yaw();
  const Se2 error(R_i_odometry.transpose() * (p_i_j - p_i_odometry),
                  yaw_i_j - T_i_j_.yaw() - shift.T.yaw());
  const Eigen::Vector3d r = error.Log();
  const Se2::Step at_error = Se2::ExpStep(r);
  const Eigen::Matrix2d R_j_i =
      at_error.inverse_adjoint.topLeftCorner<2, 2>() * R_i_odometry.transpose();
  Eigen::Matrix3d adjoint_j_i = Eigen::Matrix3d::Identity();
  adjoint_j_i.topLeftCorner<2, 2>() = R_j_i;
  adjoint_j_i.topRightCorner<2, 1>() = R_j_i * Eigen::Vector2d(-p_i_j.y(), p_i_j.x());

  const double scale = std::exp(log_range_scale);
  const Eigen::Matrix3d whitening =
      sqrt_information_ * Eigen::Vector3d(scale, scale, 1.0).asDiagonal();
  const Eigen::Matrix3d whitened = whitening * at_error.right_jacobian.inverse();
  const Eigen::Matrix3d by_shift = at_error.inverse_adjoint * shift.right_jacobian;
  Linear linear;
  linear.r = whitening * r;
  linear.J_i = -whitened * adjoint_j_i;
  linear.J_j = whitened;
  linear.J_calibration << -whitened * (by_shift * J_calibration_),
      whitening.leftCols<2>() * r.head<2>();
  return linear;
}

ObservationResidual::ObservationResidual(const GraphObservation& observation)
    : observation_(&observation),
      sqrt_information_(SqrtInformation<Eigen::Matrix2d>(observation.cov_z)) {}

ObservationResidual::Linear ObservationResidual::At(const Se2& T_map_vehicle,
                                                    const Eigen::Vector2d& p_map_landmark,
                                                    const SensorBias& bias) const {
  Eigen::Matrix<double, 2, 3> J_bias;
  const Innovation innovation = LinearizeBiased(observation_->observation,
                                                T_map_vehicle,
                                                p_map_landmark,
                                                bias,
                                                observation_->mean_squared_bearing,
                                                &J_bias);
  return {sqrt_information_ * innovation.nu,
          -sqrt_information_ * innovation.H_pose,
          -sqrt_information_ * innovation.H_landmark,
          -sqrt_information_ * J_bias};
}

}  // namespace shiftmap
