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

  // `way` is a variance in m²; for `seconds` the vehicle may have turned.
  void AddUnknown(double way, double seconds) {
    unknown_way_ += way;
    unknown_turn_ += kUnknownTurn * kUnknownTurn * seconds;
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
    motion.unknown_way = unknown_way_;
    motion.unknown_turn = unknown_turn_;
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
  double unknown_way_ = 0.0;
  double unknown_turn_ = 0.0;
};

void AppendSilence(Duration silence, MotionSum* sum) {
  if (silence > Duration::zero()) sum->Append(0.0, 0.0, std::min(ToSeconds(silence), kMaxSilence));
}

// A speed that nothing measures changes in about this time. [s]
constexpr double kSpeedKept = 10.0;

// A vehicle that moves slower stands. [m/s], [rad/s]
constexpr double kLeastSpeed = 0.01;
constexpr double kLeastTurn = 0.01;

bool Moves(const OdometrySample& sample) {
  return std::abs(sample.v_mps) > kLeastSpeed || std::abs(sample.omega_radps) > kLeastTurn;
}

// Variance of a way that began so long ago, at an unknown speed of 1 m/s: it grows with the squared
// time, as long as the speed is kept. [m²]
double UnknownWay(double seconds) {
  constexpr double kHalf = 0.5 * kSpeedKept;
  return seconds < kHalf ? seconds * seconds : kSpeedKept * seconds - kHalf * kHalf;
}

// Adds what a vehicle may do in a part of a silence, from `begin_s` to `end_s` after it began.
void AddOpenSilence(double speed_mps, double begin_s, double end_s, MotionSum* sum) {
  begin_s = std::clamp(begin_s, 0.0, kMaxSilence);
  end_s = std::clamp(end_s, begin_s, kMaxSilence);
  sum->AddUnknown(speed_mps * speed_mps * (UnknownWay(end_s) - UnknownWay(begin_s)),
                  end_s - begin_s);
}

// The same of a silence whose end is known: no part of a clock's jump is more than a short one.
void AddSilence(double speed_mps, double part_s, double silence_s, MotionSum* sum) {
  if (part_s <= 0.0) return;
  const double counted_s = std::min(silence_s, kSpeedKept);
  const double share_s = part_s * counted_s / silence_s;
  sum->AddUnknown(speed_mps * speed_mps * share_s * counted_s, share_s);
}

// Adds what may have happened from `begin` to `end`, for which sample i holds, while it was not
// fresh.
void AddUnknown(std::span<const OdometrySample> odometry,
                std::size_t i,
                double scale_v,
                Stamp begin,
                Stamp end,
                MotionSum* sum) {
  const OdometrySample& sample = odometry[i];
  const double speed_mps = scale_v * std::abs(sample.v_mps);
  const double begin_s = ToSeconds(begin - sample.stamp) - kOdometryFresh;
  const double end_s = ToSeconds(end - sample.stamp) - kOdometryFresh;
  if (begin < sample.stamp && Moves(sample)) {
    AddOpenSilence(speed_mps,
                   ToSeconds(sample.stamp - end) - kOdometryFresh,
                   ToSeconds(sample.stamp - begin) - kOdometryFresh,
                   sum);
  }
  if (i + 1 == odometry.size()) {
    if (Moves(sample)) AddOpenSilence(speed_mps, begin_s, end_s, sum);
    return;
  }
  const OdometrySample& following = odometry[i + 1];
  if (!Moves(sample) && !Moves(following)) return;
  AddSilence(std::max(speed_mps, scale_v * std::abs(following.v_mps)),
             end_s - std::max(begin_s, 0.0),
             ToSeconds(following.stamp - sample.stamp) - kOdometryFresh,
             sum);
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
          to_end * first.J_calibration + second.J_calibration,
          first.measured && second.measured};
}

// (T Exp(ξ))⁻¹ = T⁻¹ Exp(-Ad(T) ξ).
MotionIncrement Inverse(const MotionIncrement& motion) {
  const Eigen::Matrix3d A = motion.T_begin_end.Adjoint();
  return {motion.T_begin_end.Inverse(),
          A * motion.cov * A.transpose(),
          -A * motion.J_calibration,
          motion.measured};
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
      T_begin_end, noise_omega * noise_omega * cov_per_yaw_noise, J_calibration, Measured()};
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
    AddUnknown(odometry, i, calibration.scale_v, now, next, &sum);
    now = next;
    if (!final_sample && odometry[i + 1].stamp <= now) ++i;
  }
  *hint = i;
  return sum.Result();
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
