// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/odometry_check.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

constexpr double kStillMps = 0.01;
constexpr double kStillRadps = 0.01;

// Of vehicles in halls, yards and mines.
constexpr double kFastMps = 30.0;
constexpr double kSpinningRadps = 6.3;
constexpr double kUsualShare = 0.01;

// Measured velocities are never equal for so long; commanded ones seldom.
constexpr double kFrozenS = 60.0;

}  // namespace

void OdometryCheck::Add(const OdometrySample& sample) {
  ++count_;
  const double speed_mps = std::abs(sample.v_mps);
  const double yaw_rate_radps = std::abs(sample.omega_radps);
  max_speed_mps_ = std::max(max_speed_mps_, speed_mps);
  max_yaw_rate_radps_ = std::max(max_yaw_rate_radps_, yaw_rate_radps);
  const bool moving = speed_mps > kStillMps || yaw_rate_radps > kStillRadps;
  if (moving) ++moving_;
  if (speed_mps > kFastMps) ++fast_;
  if (yaw_rate_radps > kSpinningRadps) ++spinning_;
  if (!IsPlausible(sample, limits_)) {
    ++implausible_;
    if (!first_implausible_) first_implausible_ = sample.stamp;
  }
  if (!same_ || same_->v_mps != sample.v_mps || same_->omega_radps != sample.omega_radps) {
    same_ = sample;
  }
  if (moving && sample.stamp - same_->stamp > longest_same_) {
    longest_same_ = sample.stamp - same_->stamp;
    longest_same_from_ = same_->stamp;
  }
}

void OdometryCheck::Report(Stamp begin, Findings* findings) const {
  if (count_ == 0) return;
  if (moving_ == 0) {
    findings->push_back(
        {Severity::kWarning,
         "standing_still",
         "odometry",
         "the vehicle never moves",
         "see whether the driver reports velocities; where it fills in poses alone, convert with "
         "--odometry-from-pose"});
  }
  if (ToSeconds(longest_same_) > kFrozenS) {
    findings->push_back(
        {Severity::kWarning,
         "odometry_constant",
         fmt::format("odometry, {}", TimeInRun(longest_same_from_, begin)),
         fmt::format("the same velocity, not 0, for {:.1f} s", ToSeconds(longest_same_)),
         "see whether the driver stopped, or commands were logged as measurements"});
  }
  ReportLimits(begin, findings);
}

void OdometryCheck::ReportLimits(Stamp begin, Findings* findings) const {
  const double least = kUsualShare * static_cast<double>(count_);
  if (static_cast<double>(fast_) > least) {
    findings->push_back({Severity::kWarning,
                         "speed_unit",
                         "odometry",
                         fmt::format("{} of {} speeds are above {} m/s, up to {:.3g}",
                                     fast_,
                                     count_,
                                     kFastMps,
                                     max_speed_mps_),
                         "write metres per second, not millimetres or kilometres per hour"});
  }
  if (static_cast<double>(spinning_) > least) {
    findings->push_back({Severity::kWarning,
                         "yaw_rate_unit",
                         "odometry",
                         fmt::format("{} of {} yaw rates are above {} rad/s, up to {:.3g}",
                                     spinning_,
                                     count_,
                                     kSpinningRadps,
                                     max_yaw_rate_radps_),
                         "write radians per second, not degrees"});
  }
  if (implausible_ > 0) {
    findings->push_back(
        {Severity::kWarning,
         "odometry_limit",
         fmt::format("odometry, {}", TimeInRun(*first_implausible_, begin)),
         fmt::format("{} of {} samples are above {} m/s or {} rad/s and are not used",
                     implausible_,
                     count_,
                     limits_.max_speed_mps,
                     limits_.max_yaw_rate_radps),
         "leave out values that mean 'no reading'"});
  }
}

}  // namespace shiftmap
