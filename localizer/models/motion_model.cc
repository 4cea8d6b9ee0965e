// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/motion_model.h"

#include <algorithm>
#include <cmath>

#include "mapstore/geometry/arc_factors.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kStandstillVarianceShare = 0.01;  // Wheels that stand hardly slip.

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
    const double u_step_x = f.sinc_rest * way;
    const double u_step_y = -f.cosc_rest * way;
    const double u_x = cos_ * u_step_x - sin_ * u_step_y + y_;
    const double u_y = sin_ * u_step_x + cos_ * u_step_y - x_;
    slip_s_ += weight_s * (f.sinc * f.sinc + f.cosc * f.cosc);
    weight_s_ += weight_s;
    weight_x_ += weight_s * u_x;
    weight_y_ += weight_s * u_y;
    weight_xx_ += weight_s * u_x * u_x;
    weight_xy_ += weight_s * u_x * u_y;
    weight_yy_ += weight_s * u_y * u_y;
    turn_x_ += turn * u_x;
    turn_y_ += turn * u_y;

    const double step_x = f.sinc * way;
    const double step_y = f.cosc * way;
    x_ += cos_ * step_x - sin_ * step_y;
    y_ += sin_ * step_x + cos_ * step_y;
    yaw_ += turn;
    const double cos = cos_ * f.cos - sin_ * f.sin;
    sin_ = sin_ * f.cos + cos_ * f.sin;
    cos_ = cos;
  }

  IntegratedMotion Result() const {
    IntegratedMotion motion;
    motion.T_begin_end = Se2(x_, y_, yaw_);
    const Eigen::Matrix3d to_end = motion.T_begin_end.InverseAdjoint();
    Eigen::Matrix3d yaw_noise;
    yaw_noise << weight_xx_, weight_xy_, weight_x_, weight_xy_, weight_yy_, weight_y_, weight_x_,
        weight_y_, weight_s_;
    motion.J_calibration.col(0) = to_end.leftCols<2>() * Eigen::Vector2d(x_, y_);
    motion.J_calibration.col(1) = to_end * Eigen::Vector3d(turn_x_, turn_y_, yaw_);
    motion.slip_s = slip_s_;
    motion.cov_per_yaw_noise = to_end * yaw_noise * to_end.transpose();
    return motion;
  }

 private:
  double x_ = 0.0;
  double y_ = 0.0;
  double yaw_ = 0.0;
  double cos_ = 1.0;
  double sin_ = 0.0;
  double slip_s_ = 0.0;
  // Sums of weight_s u uᵀ and of turn u, with u = (u_x, u_y, 1).
  double weight_s_ = 0.0;
  double weight_x_ = 0.0;
  double weight_y_ = 0.0;
  double weight_xx_ = 0.0;
  double weight_xy_ = 0.0;
  double weight_yy_ = 0.0;
  double turn_x_ = 0.0;
  double turn_y_ = 0.0;
};

void AppendSilence(Duration silence, MotionSum* sum) {
  if (silence > Duration::zero()) sum->Append(0.0, 0.0, std::min(ToSeconds(silence), kMaxSilence));
}

// So long a vehicle is taken to drive on where odometry is silent [s], and to turn so [rad/√s].
constexpr double kMaxUnknownDrive = 10.0;
constexpr double kUnknownTurn = 0.5;

// Adds what may have happened in a part of a silence. Its speed is unknown and constant, so that
// the way grows with the time and not with its root: parts of one silence add up to that.
void AddUnknown(double speed_mps, double part_s, double silence_s, IntegratedMotion* motion) {
  if (part_s <= 0.0) return;
  const double counted_s = std::min(silence_s, kMaxUnknownDrive);
  const double share_s = part_s * counted_s / silence_s;
  motion->unknown_way += speed_mps * speed_mps * share_s * counted_s;
  motion->unknown_turn += kUnknownTurn * kUnknownTurn * share_s;
}

}  // namespace

PoseWithCovariance Moved(const PoseWithCovariance& pose, const MotionIncrement& motion) {
  const Eigen::Matrix3d F = motion.T_begin_end.InverseAdjoint();
  return {pose.T_map_vehicle * motion.T_begin_end,
          Symmetrized(F * pose.cov_T_map_vehicle * F.transpose() + motion.cov)};
}

MotionIncrement EulerStep(const Se2& T_map_vehicle,
                          double v_mps,
                          double omega_radps,
                          double seconds,
                          const Eigen::Matrix3d& Q) {
  MotionIncrement step;
  step.T_begin_end = Se2(v_mps * seconds, 0.0, omega_radps * seconds);
  // From the map's axes to the vehicle's at the end of the step.
  Eigen::Matrix3d R = Eigen::Matrix3d::Identity();
  R.topLeftCorner<2, 2>() = (T_map_vehicle * step.T_begin_end).Rotation().transpose();
  step.cov = R * Q * R.transpose();
  return step;
}

MotionIncrement Compose(const MotionIncrement& first, const MotionIncrement& second) {
  const Eigen::Matrix3d to_end = second.T_begin_end.InverseAdjoint();
  return {first.T_begin_end * second.T_begin_end,
          Symmetrized(to_end * first.cov * to_end.transpose() + second.cov),
          to_end * first.J_calibration + second.J_calibration};
}

// (T Exp(ξ))⁻¹ = T⁻¹ Exp(-Ad(T) ξ).
MotionIncrement Inverse(const MotionIncrement& motion) {
  const Eigen::Matrix3d A = motion.T_begin_end.Adjoint();
  return {motion.T_begin_end.Inverse(), A * motion.cov * A.transpose(), -A * motion.J_calibration};
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
  increment.cov.diagonal().head<2>().array() += noise_v * noise_v * slip_s + unknown_way;
  increment.cov(2, 2) += unknown_turn;
  return increment;
}

IntegratedMotion IntegrateOdometry(std::span<const OdometrySample> odometry,
                                   Stamp begin,
                                   Stamp end,
                                   const OdometryCalibration& calibration,
                                   std::size_t* hint) {
  SHIFTMAP_CHECK(!odometry.empty() && begin <= end, "{} samples", odometry.size());
  const Duration lag = FromSeconds(calibration.lag_s);
  const Duration hold = FromSeconds(kOdometryHold);
  const Stamp last = end - lag;
  Stamp now = begin - lag;

  std::size_t i = std::min(*hint, odometry.size() - 1);
  while (i > 0 && odometry[i].stamp > now) --i;
  while (i + 1 < odometry.size() && odometry[i + 1].stamp <= now) ++i;

  MotionSum sum;
  IntegratedMotion unknown;
  const Duration fresh = FromSeconds(kOdometryFresh);
  const auto moves = [&](const OdometrySample& sample) {
    return sample.v_mps != 0.0 || sample.omega_radps != 0.0;
  };
  while (now < last) {
    const bool final_sample = i + 1 == odometry.size();
    const Stamp next = final_sample ? last : std::min(last, odometry[i + 1].stamp);
    const auto [stamp, v_mps, omega_radps] = odometry[i];
    const Stamp from = std::clamp(stamp - hold, now, next);  // Later than `now` at the first only.
    const Stamp to = std::clamp(stamp + hold, from, next);
    const double dt = ToSeconds(to - from);
    AppendSilence(from - now, &sum);
    sum.Append(calibration.scale_v * v_mps * dt,
               calibration.scale_omega * omega_radps * dt,
               dt * VarianceShare(v_mps, omega_radps));
    AppendSilence(next - to, &sum);
    const OdometrySample& following = final_sample ? odometry[i] : odometry[i + 1];
    if (moves(odometry[i]) || moves(following)) {
      const double speed_mps =
          calibration.scale_v * std::max(std::abs(v_mps), std::abs(following.v_mps));
      const double before_s = ToSeconds(stamp - fresh - now);
      AddUnknown(speed_mps, std::min(before_s, ToSeconds(next - now)), before_s, &unknown);
      const Stamp silence_end = final_sample ? last : following.stamp;
      AddUnknown(speed_mps,
                 ToSeconds(next - std::max(now, stamp + fresh)),
                 ToSeconds(silence_end - stamp - fresh),
                 &unknown);
    }
    now = next;
    if (!final_sample && odometry[i + 1].stamp <= now) ++i;
  }
  *hint = i;
  IntegratedMotion motion = sum.Result();
  motion.unknown_way = unknown.unknown_way;
  motion.unknown_turn = unknown.unknown_turn;
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
