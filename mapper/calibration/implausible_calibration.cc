// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/implausible_calibration.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

// Ten times the prior standard deviation and more; a person who mounts a sensor gets nearer. [rad]
constexpr double kMaxBearingOffset = 0.6;

// Odometry in other units, or of another wheel.
constexpr double kMaxScale = 2.0;

// Recorded robots lose 0.02 to 0.04. [rad/√s]
constexpr double kMaxHeadingNoise = 0.12;

// What detects landmarks tells their direction at least this well. [rad]
constexpr double kMaxBearingNoise = 0.5;

// Log odds from which on odometry counts turns the other way.
constexpr double kSurelyReversed = 10.0;

bool IsScale(double scale) { return scale < kMaxScale && scale > 1.0 / kMaxScale; }

// Log odds that the vehicle turned against odometry rather than with it, each step's difference
// with the most noise that a working vehicle has. A scale cannot say so: it has no sign, and what
// it does not explain becomes noise.
double LogOddsOfReversedTurns(const BuildRun& run) {
  double log_odds = 0.0;
  const std::vector<FrameIndex> broken = BrokenMotions(run.motions);
  for (const FrameIndex i : run.motions.between_frames.indices()) {
    if (std::binary_search(broken.begin(), broken.end(), i)) continue;
    const double odometry = run.motions.between_frames[i].T_begin_end.yaw();
    const double turned = run.poses[i + 1].yaw() - run.poses[i].yaw();
    const double seconds = ToSeconds(run.data->frames[i + 1].stamp - run.data->frames[i].stamp);
    if (seconds <= 0.0) continue;  // Scans of one time.
    const double with = WrapAngle(turned - odometry);
    const double against = WrapAngle(turned + odometry);
    log_odds +=
        (with * with - against * against) / (2.0 * kMaxHeadingNoise * kMaxHeadingNoise * seconds);
  }
  return log_odds;
}

}  // namespace

std::string ImplausibleCalibration(const BuildState& build) {
  const BuildRun& run = build.runs.front();
  const double offset = std::remainder(run.sensor_bias[kBearingOffset], 2.0 * std::numbers::pi);
  if (!(std::abs(offset) < kMaxBearingOffset)) {
    return fmt::format(
        "it fits only with a sensor turned by {:.0f} degrees: reversed odometry, or another "
        "mounting than the log says",
        offset * 180.0 / std::numbers::pi);
  }
  if (LogOddsOfReversedTurns(run) > kSurelyReversed) {
    return "it fits only if it turns the other way than odometry says: bearings or yaw rates of "
           "the wrong sign";
  }
  if (!IsScale(run.odometry.scale_v)) {
    return fmt::format(
        "it fits only with speeds of {:.2f} times what odometry says: {}",
        run.odometry.scale_v,
        run.odometry.scale_v < 1.0 ? "another unit, or reversed odometry" : "another unit");
  }
  if (!IsScale(run.odometry.scale_omega)) {
    return fmt::format("it fits only with yaw rates of {:.2f} times what odometry says",
                       run.odometry.scale_omega);
  }
  if (!(run.odometry.noise_omega < kMaxHeadingNoise)) {
    return fmt::format("it fits only if odometry loses the heading by {:.0f} degrees in a second",
                       run.odometry.noise_omega * 180.0 / std::numbers::pi);
  }
  if (!(build.sensor.sd_bearing_rad < kMaxBearingNoise)) {
    return fmt::format("it fits only with bearings that are wrong by {:.0f} degrees: another unit",
                       build.sensor.sd_bearing_rad * 180.0 / std::numbers::pi);
  }
  return "";
}

}  // namespace shiftmap
