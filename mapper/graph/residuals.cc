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
    : T_i_j_(motion.T_begin_end), J_calibration_(motion.J_calibration) {
  const Eigen::Matrix3d floor = Eigen::Matrix3d::Identity() * (kMinMotionSd * kMinMotionSd);
  sqrt_information_ = SqrtInformation<Eigen::Matrix3d>(motion.cov + floor);
}

MotionResidual::Linear MotionResidual::At(const Se2& T_map_i,
                                          const Se2& T_map_j,
                                          const Eigen::Vector3d& correction,
                                          double log_range_scale) const {
  const Se2::Step shift = Se2::ExpStep(J_calibration_ * correction);
  const Se2 T_i_j = T_map_i.Inverse() * T_map_j;
  const Se2 error = (T_i_j_ * shift.T).Inverse() * T_i_j;
  const Eigen::Vector3d r = error.Log();
  const double scale = std::exp(log_range_scale);
  const Eigen::Matrix3d whitening =
      sqrt_information_ * Eigen::Vector3d(scale, scale, 1.0).asDiagonal();
  const Eigen::Matrix3d whitened = whitening * Se2::RightJacobian(r).inverse();
  Linear linear;
  linear.r = whitening * r;
  linear.J_i = -whitened * T_i_j.InverseAdjoint();
  linear.J_j = whitened;
  linear.J_calibration << -whitened * error.InverseAdjoint() * shift.right_jacobian *
                              J_calibration_,
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
