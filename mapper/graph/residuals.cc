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

MotionResidual::MotionResidual(const MotionIncrement& motion, double variance_factor)
    : T_i_j_(motion.T_begin_end), R_i_j_(T_i_j_.Rotation()), J_calibration_(motion.J_calibration) {
  const Eigen::Matrix3d floor = Eigen::Matrix3d::Identity() * (kMinMotionSd * kMinMotionSd);
  // Yaw by itself, and what it does not explain of x and y: so each has a noise of its own.
  const Eigen::Matrix3d from_yaw = variance_factor * (motion.cov + floor).reverse();
  sqrt_information_ = SqrtInformation<Eigen::Matrix3d>(from_yaw).reverse();
}

MotionResidual::Difference MotionResidual::DifferenceAt(const Se2& T_map_i,
                                                        const Eigen::Matrix2d& R_map_i,
                                                        const Se2& T_map_j,
                                                        const Eigen::Vector3d& correction) const {
  // Rotations are chained as matrices: one sine and cosine for all of them.
  Difference d;
  d.shift = Se2::ExpStep(J_calibration_ * correction);
  d.R_i_odometry = R_i_j_ * d.shift.inverse_adjoint.topLeftCorner<2, 2>().transpose();
  const Eigen::Vector2d p_i_odometry = T_i_j_.translation() + R_i_j_ * d.shift.T.translation();
  d.p_i_j = R_map_i.transpose() * (T_map_j.translation() - T_map_i.translation());
  const double yaw_i_j = T_map_j.yaw() - T_map_i.yaw();
  d.error = Se2(d.R_i_odometry.transpose() * (d.p_i_j - p_i_odometry),
                yaw_i_j - T_i_j_.yaw() - d.shift.T.yaw());
  d.arc = ComputeArcFactors(d.error.yaw());
  const double scale = 1.0 / (d.arc.sinc * d.arc.sinc + d.arc.cosc * d.arc.cosc);
  const double sinc = scale * d.arc.sinc;
  const double cosc = scale * d.arc.cosc;
  d.A << sinc, -cosc, cosc, sinc;
  d.r << d.A.transpose() * d.error.translation(), d.error.yaw();
  return d;
}

Eigen::Matrix3d MotionResidual::Whitening(double log_range_scale) const {
  Eigen::Matrix3d whitening = sqrt_information_;
  whitening.leftCols<2>() *= std::exp(log_range_scale);
  return whitening;
}

Eigen::Vector3d MotionResidual::ResidualAt(const Se2& T_map_i,
                                           const Eigen::Matrix2d& R_map_i,
                                           const Se2& T_map_j,
                                           const Eigen::Vector3d& correction,
                                           double log_range_scale) const {
  return Whitening(log_range_scale) * DifferenceAt(T_map_i, R_map_i, T_map_j, correction).r;
}

// Jacobians of SE(2) and adjoints have the last row (0, 0, 1): they are worked with as their upper
// left block and the column beside it.
MotionResidual::Linear MotionResidual::At(const Se2& T_map_i,
                                          const Eigen::Matrix2d& R_map_i,
                                          const Se2& T_map_j,
                                          const Eigen::Vector3d& correction,
                                          double log_range_scale) const {
  const Difference d = DifferenceAt(T_map_i, R_map_i, T_map_j, correction);
  const ArcFactors& arc = d.arc;
  const Eigen::Matrix3d whitening = Whitening(log_range_scale);

  // By pose j: the inverse of the right Jacobian of Exp at r.
  const Eigen::Vector2d a(arc.sinc_rest * d.r.x() - arc.cosc_rest * d.r.y(),
                          arc.cosc_rest * d.r.x() + arc.sinc_rest * d.r.y());
  Eigen::Matrix3d whitened;
  whitened.leftCols<2>() = whitening.leftCols<2>() * d.A;
  whitened.col(2) = whitening.col(2) - whitened.leftCols<2>() * a;

  // By pose i: the adjoint of T_j_i with it.
  Eigen::Matrix2d R_j_odometry;
  R_j_odometry << arc.cos, arc.sin, -arc.sin, arc.cos;
  const Eigen::Matrix2d R_j_i = R_j_odometry * d.R_i_odometry.transpose();
  const Eigen::Vector2d t_j_i = R_j_i * Eigen::Vector2d(-d.p_i_j.y(), d.p_i_j.x());

  // By the correction: shift and odometry's end, seen from pose j.
  const Eigen::Vector2d& e = d.error.translation();
  const Eigen::Vector2d shifted = R_j_odometry * (d.shift.right_jacobian.topRightCorner<2, 1>() +
                                                  Eigen::Vector2d(-e.y(), e.x()));
  const Eigen::Matrix<double, 2, 3> by_calibration =
      (R_j_odometry * d.shift.right_jacobian.topLeftCorner<2, 2>()) * J_calibration_.topRows<2>() +
      shifted * J_calibration_.row(2);

  Linear linear;
  linear.r = whitening * d.r;
  linear.J_i.leftCols<2>() = -whitened.leftCols<2>() * R_j_i;
  linear.J_i.col(2) = -(whitened.leftCols<2>() * t_j_i) - whitened.col(2);
  linear.J_j = whitened;
  linear.J_calibration.leftCols<3>() =
      -(whitened.leftCols<2>() * by_calibration) - whitened.col(2) * J_calibration_.row(2);
  linear.J_calibration.col(3) = whitening.leftCols<2>() * d.r.head<2>();
  return linear;
}

ObservationResidual::ObservationResidual(const GraphObservation& observation)
    : observation_(&observation),
      sqrt_information_(SqrtInformation<Eigen::Matrix2d>(observation.cov_z)) {}

// The landmark is seen from the vehicle's own frame, in which the pose is the identity.
ObservationResidual::Linear ObservationResidual::At(const Se2& T_map_vehicle,
                                                    const Eigen::Matrix2d& R_map_vehicle,
                                                    const Eigen::Vector2d& p_map_landmark,
                                                    const SensorBias& bias) const {
  const Eigen::Vector2d p_vehicle_landmark =
      R_map_vehicle.transpose() * (p_map_landmark - T_map_vehicle.translation());
  Eigen::Matrix<double, 2, 3> J_bias;
  const Innovation innovation = LinearizeBiased(observation_->observation,
                                                Se2(),
                                                p_vehicle_landmark,
                                                bias,
                                                observation_->mean_squared_bearing,
                                                &J_bias);
  const Eigen::Matrix2d by_landmark = -sqrt_information_ * innovation.H_landmark;
  return {sqrt_information_ * innovation.nu,
          -sqrt_information_ * innovation.H_pose,
          by_landmark * R_map_vehicle.transpose(),
          -sqrt_information_ * J_bias};
}

Eigen::Vector2d ObservationResidual::ResidualAt(const Se2& T_map_vehicle,
                                                const Eigen::Matrix2d& R_map_vehicle,
                                                const Eigen::Vector2d& p_map_landmark,
                                                const SensorBias& bias) const {
  const Eigen::Vector2d p_vehicle_landmark =
      R_map_vehicle.transpose() * (p_map_landmark - T_map_vehicle.translation());
  return sqrt_information_ * LinearizeBiased(observation_->observation,
                                             Se2(),
                                             p_vehicle_landmark,
                                             bias,
                                             observation_->mean_squared_bearing)
                                 .nu;
}

IndexedVector<RunIndex, RobustLoss> LossesOf(const Graph& graph) {
  IndexedVector<RunIndex, RobustLoss> losses;
  for (const GraphRun& run : graph.runs) {
    losses.emplace_back(graph.loss_scale, graph.loss_reach, run.variance_factor);
  }
  return losses;
}

}  // namespace shiftmap
