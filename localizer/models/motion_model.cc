// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/motion_model.h"

#include <algorithm>

#include "mapstore/geometry/arc_factors.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kStandstillVarianceShare = 0.01;

// Part of the variance of moving that a stretch has.
double VarianceShare(double v_mps, double omega_radps) {
  return v_mps == 0.0 && omega_radps == 0.0 ? kStandstillVarianceShare : 1.0;
}

// Adds up stretches of constant velocity. In the frame where the motion begins, perturbations
// Exp(ξ)·T add up as they are; they are moved to its end once. There, scaling all velocities v
// scales the way, and noise of v that is the same along x and y stays so. What is left are sums
// over u, how a turn in a stretch moves the end.
class MotionSum {
 public:
  // `way` along x in metres, `turn` in radians, `weight_s` the time, less where noise is less.
  void Append(double way, double turn, double weight_s) {
    const ArcFactors f = ComputeArcFactors(turn);
    const Eigen::Vector2d u_step(f.sinc_rest * way, -f.cosc_rest * way);
    const Eigen::Vector3d u(cos_ * u_step.x() - sin_ * u_step.y() + p_.y(),
                            sin_ * u_step.x() + cos_ * u_step.y() - p_.x(),
                            1.0);
    slip_s_ += weight_s * (f.sinc * f.sinc + f.cosc * f.cosc);
    yaw_noise_ += (weight_s * u) * u.transpose();
    by_turn_ += turn * u;

    const Eigen::Vector2d step(f.sinc * way, f.cosc * way);
    p_ += Eigen::Vector2d(cos_ * step.x() - sin_ * step.y(), sin_ * step.x() + cos_ * step.y());
    yaw_ += turn;
    const double cos = cos_ * f.cos - sin_ * f.sin;
    sin_ = sin_ * f.cos + cos_ * f.sin;
    cos_ = cos;
  }

  IntegratedMotion Result() const {
    IntegratedMotion motion;
    motion.T_begin_end = Se2(p_, yaw_);
    const Eigen::Matrix3d to_end = motion.T_begin_end.InverseAdjoint();
    motion.J_calibration.col(0) = to_end.leftCols<2>() * p_;
    motion.J_calibration.col(1) = to_end * by_turn_;
    motion.slip_s = slip_s_;
    motion.cov_per_yaw_noise = to_end * yaw_noise_ * to_end.transpose();
    return motion;
  }

 private:
  Eigen::Vector2d p_ = Eigen::Vector2d::Zero();
  double yaw_ = 0.0;
  double cos_ = 1.0;
  double sin_ = 0.0;
  double slip_s_ = 0.0;
  Eigen::Vector3d by_turn_ = Eigen::Vector3d::Zero();
  Eigen::Matrix3d yaw_noise_ = Eigen::Matrix3d::Zero();
};

Eigen::Vector3d ScaledVelocity(const OdometrySample& sample,
                               const OdometryCalibration& calibration) {
  return {calibration.scale_v * sample.v_mps, 0.0, calibration.scale_omega * sample.omega_radps};
}

}  // namespace

PoseWithCovariance Moved(const PoseWithCovariance& pose, const MotionIncrement& motion) {
  const Eigen::Matrix3d F = motion.T_begin_end.InverseAdjoint();
  return {pose.T_map_vehicle * motion.T_begin_end,
          Symmetrized(F * pose.cov_T_map_vehicle * F.transpose() + motion.cov)};
}

void AppendMotion(double v_mps,
                  double omega_radps,
                  Duration elapsed,
                  const OdometryCalibration& calibration,
                  MotionIncrement* increment) {
  const double dt = ToSeconds(elapsed);
  const Eigen::Vector3d twist(
      calibration.scale_v * v_mps * dt, 0.0, calibration.scale_omega * omega_radps * dt);
  const auto [step, to_end, right] = Se2::ExpStep(twist);

  const double variance_scale = dt * VarianceShare(v_mps, omega_radps);
  const double variance_v = calibration.noise_v * calibration.noise_v * variance_scale;
  const double variance_omega = calibration.noise_omega * calibration.noise_omega * variance_scale;
  const Eigen::Vector3d variance(variance_v, variance_v, variance_omega);

  increment->T_begin_end = increment->T_begin_end * step;
  increment->cov = to_end * increment->cov * to_end.transpose();
  increment->cov += right * variance.asDiagonal() * right.transpose();
  increment->J_calibration = to_end * increment->J_calibration;
  increment->J_calibration.col(0) += right.col(0) * twist.x();
  increment->J_calibration.col(1) += right.col(2) * twist.z();
}

MotionIncrement IntegratedMotion::WithNoise(double noise_v, double noise_omega) const {
  MotionIncrement increment{
      T_begin_end, noise_omega * noise_omega * cov_per_yaw_noise, J_calibration};
  increment.cov.diagonal().head<2>().array() += noise_v * noise_v * slip_s;
  return increment;
}

IntegratedMotion IntegrateOdometry(std::span<const OdometrySample> odometry,
                                   Stamp begin,
                                   Stamp end,
                                   const OdometryCalibration& calibration,
                                   std::size_t* hint) {
  SHIFTMAP_CHECK(!odometry.empty() && begin <= end, "{} samples", odometry.size());
  const Duration lag = FromSeconds(calibration.lag_s);
  const Stamp last = end - lag;
  Stamp now = begin - lag;

  std::size_t i = std::min(*hint, odometry.size() - 1);
  while (i > 0 && odometry[i].stamp > now) --i;
  while (i + 1 < odometry.size() && odometry[i + 1].stamp <= now) ++i;
  const Eigen::Vector3d begin_velocity = ScaledVelocity(odometry[i], calibration);

  MotionSum sum;
  while (now < last) {
    const bool final_sample = i + 1 == odometry.size();
    const Stamp next = final_sample ? last : std::min(last, odometry[i + 1].stamp);
    const auto [stamp, v_mps, omega_radps] = odometry[i];
    const double dt = ToSeconds(next - now);
    sum.Append(calibration.scale_v * v_mps * dt,
               calibration.scale_omega * omega_radps * dt,
               dt * VarianceShare(v_mps, omega_radps));
    now = next;
    if (!final_sample && odometry[i + 1].stamp <= now) ++i;
  }
  *hint = i;

  // T(lag) = D(begin - lag)⁻¹ D(end - lag) for the dead-reckoned path D.
  IntegratedMotion motion = sum.Result();
  const Eigen::Vector3d end_velocity = ScaledVelocity(odometry[i], calibration);
  motion.J_calibration.col(2) = motion.T_begin_end.InverseAdjoint() * begin_velocity - end_velocity;
  return motion;
}

MotionIncrement IntegrateMotion(std::span<const OdometrySample> odometry,
                                Stamp begin,
                                Stamp end,
                                const OdometryCalibration& calibration,
                                std::size_t* hint) {
  return IntegrateOdometry(odometry, begin, end, calibration, hint)
      .WithNoise(calibration.noise_v, calibration.noise_omega);
}

}  // namespace shiftmap
