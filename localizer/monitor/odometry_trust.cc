// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/odometry_trust.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

// How well landmarks must determine the pose.
constexpr double kMaxSdM = 0.3;
constexpr double kMaxSdRad = 0.1;

// How far good odometry is from what landmarks show: this, two standard deviations of either pose,
// and a share of what it has counted.
constexpr double kDifferM = 0.1;
constexpr double kDifferRad = 0.05;
constexpr double kShareDiffers = 0.1;

// The motion by which odometry shows that it is right. It must not differ by most of it.
constexpr double kShownM = 1.0;
constexpr double kShownRad = 0.5;
constexpr double kMostShare = 0.8;

// A way that shows it without a turn. A gyro may be dead on it; landmarks tell at the next turn.
constexpr double kLongWayM = 10.0;

}  // namespace

void OdometryTrust::Distrust() {
  trusted_ = false;
  begin_.reset();
}

void OdometryTrust::Move(const Se2& T_begin_end) {
  if (trusted_) return;
  T_begin_vehicle_ = T_begin_vehicle_ * T_begin_end;
  way_m_ += T_begin_end.translation().norm();
  turn_rad_ += std::abs(T_begin_end.yaw());
}

void OdometryTrust::Agree(std::span<const Se2> motions) {
  double way_m = 0.0;
  double turn_rad = 0.0;
  for (const Se2& motion : motions) {
    way_m += motion.translation().norm();
    turn_rad += std::abs(motion.yaw());
  }
  trusted_ |= way_m >= kLongWayM || (way_m >= kShownM && turn_rad >= kShownRad);
}

void OdometryTrust::Compare(const PoseWithCovariance& pose) {
  if (trusted_) return;
  const Determined now{pose.T_map_vehicle,
                       LargestSd(pose.cov_T_map_vehicle.topLeftCorner<2, 2>()),
                       std::sqrt(pose.cov_T_map_vehicle(2, 2))};
  if (now.sd_m > kMaxSdM || now.sd_rad > kMaxSdRad) return;
  if (!begin_) return BeginAt(now);
  const double may_differ_m = kDifferM + 2.0 * std::hypot(begin_->sd_m, now.sd_m) +
                              (kShareDiffers + kDifferRad + 2.0 * begin_->sd_rad) * way_m_;
  const double may_differ_rad =
      kDifferRad + 2.0 * std::hypot(begin_->sd_rad, now.sd_rad) + kShareDiffers * turn_rad_;
  const Se2 moved = begin_->T_map_vehicle.Inverse() * now.T_map_vehicle;
  const Se2 difference = T_begin_vehicle_.Inverse() * moved;
  if (difference.translation().norm() > std::min(may_differ_m, kMostShare * kShownM) ||
      std::abs(difference.yaw()) > std::min(may_differ_rad, kMostShare * kShownRad)) {
    return BeginAt(now);
  }
  has_shown_way_ |= moved.translation().norm() >= kShownM;
  has_shown_turn_ |= std::abs(moved.yaw()) >= kShownRad;
  trusted_ = has_shown_way_ && has_shown_turn_;
}

void OdometryTrust::BeginAt(const Determined& pose) {
  begin_ = pose;
  T_begin_vehicle_ = Se2();
  way_m_ = turn_rad_ = 0.0;
  has_shown_way_ = has_shown_turn_ = false;
}

}  // namespace shiftmap
