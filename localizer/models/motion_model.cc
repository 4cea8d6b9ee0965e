// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/motion_model.h"

#include <algorithm>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kStandstillVarianceShare = 0.01;

Eigen::Vector3d ScaledVelocity(const OdometrySample& sample,
                               const OdometryCalibration& calibration) {
  return {calibration.scale_v * sample.v_mps, 0.0, calibration.scale_omega * sample.omega_radps};
}

}  // namespace

void AppendMotion(double v_mps,
                  double omega_radps,
                  Duration elapsed,
                  const OdometryCalibration& calibration,
                  MotionIncrement* increment) {
  const double dt = ToSeconds(elapsed);
  const Eigen::Vector3d twist(
      calibration.scale_v * v_mps * dt, 0.0, calibration.scale_omega * omega_radps * dt);
  const auto [step, to_end, right] = Se2::ExpStep(twist);

  const bool standstill = v_mps == 0.0 && omega_radps == 0.0;
  const double variance_scale = dt * (standstill ? kStandstillVarianceShare : 1.0);
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

MotionIncrement IntegrateMotion(std::span<const OdometrySample> odometry,
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

  MotionIncrement increment;
  while (now < last) {
    const bool final_sample = i + 1 == odometry.size();
    const Stamp next = final_sample ? last : std::min(last, odometry[i + 1].stamp);
    AppendMotion(odometry[i].v_mps, odometry[i].omega_radps, next - now, calibration, &increment);
    now = next;
    if (!final_sample && odometry[i + 1].stamp <= now) ++i;
  }
  *hint = i;

  // T(lag) = D(begin - lag)⁻¹ D(end - lag) for the dead-reckoned path D.
  const Eigen::Vector3d end_velocity = ScaledVelocity(odometry[i], calibration);
  increment.J_calibration.col(2) =
      increment.T_begin_end.InverseAdjoint() * begin_velocity - end_velocity;
  return increment;
}

}  // namespace shiftmap
