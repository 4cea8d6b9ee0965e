// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/odometry_trust.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

// The motion by which odometry shows that it is right.
constexpr double kShownM = 1.0;
constexpr double kShownRad = 0.5;

// How well landmarks must determine the pose.
constexpr double kMaxSdM = 0.3;
constexpr double kMaxSdRad = 0.1;

// How far good odometry is from what landmarks show: this, two standard deviations of either pose,
// and a share of what it has counted.
constexpr double kDifferM = 0.1;
constexpr double kDifferRad = 0.05;
constexpr double kShareDiffers = 0.1;

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

void OdometryTrust::Compare(const PoseWithCovariance& pose) {
  if (trusted_) return;
  const Determined now{pose.T_map_vehicle,
                       LargestSd(pose.cov_T_map_vehicle.topLeftCorner<2, 2>()),
                       std::sqrt(pose.cov_T_map_vehicle(2, 2))};
  if (now.sd_m > kMaxSdM || now.sd_rad > kMaxSdRad) return;
  if (!begin_ || !Agrees(now)) return BeginAt(now);
  const Se2 moved = begin_->T_map_vehicle.Inverse() * now.T_map_vehicle;
  farthest_m_ = std::max(farthest_m_, moved.translation().norm());
  most_turned_rad_ = std::max(most_turned_rad_, std::abs(moved.yaw()));
  trusted_ = farthest_m_ >= kShownM && most_turned_rad_ >= kShownRad;
}

void OdometryTrust::BeginAt(const Determined& pose) {
  begin_ = pose;
  T_begin_vehicle_ = Se2();
  way_m_ = turn_rad_ = farthest_m_ = most_turned_rad_ = 0.0;
}

bool OdometryTrust::Agrees(const Determined& pose) const {
  const Se2 difference = (begin_->T_map_vehicle * T_begin_vehicle_).Inverse() * pose.T_map_vehicle;
  const double by_heading_m = way_m_ * (kDifferRad + 2.0 * begin_->sd_rad);
  return difference.translation().norm() <= kDifferM + 2.0 * std::hypot(begin_->sd_m, pose.sd_m) +
                                                kShareDiffers * way_m_ + by_heading_m &&
         std::abs(difference.yaw()) <=
             kDifferRad + 2.0 * std::hypot(begin_->sd_rad, pose.sd_rad) + kShareDiffers * turn_rad_;
}

}  // namespace shiftmap
