// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/implausible_calibration.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

namespace shiftmap {
namespace {

// Ten times the prior standard deviation and more; a person who mounts a sensor gets nearer. [rad]
constexpr double kMaxBearingOffset = 0.6;

// Odometry in other units, or of another wheel.
constexpr double kMaxScale = 2.0;

// Recorded robots lose 0.02 to 0.04. [rad/√s]
constexpr double kMaxHeadingNoise = 0.12;

bool IsScale(double scale) { return scale < kMaxScale && scale > 1.0 / kMaxScale; }

}  // namespace

std::string ImplausibleCalibration(const BuildRun& run) {
  const double offset = std::remainder(run.sensor_bias[kBearingOffset], 2.0 * std::numbers::pi);
  if (!(std::abs(offset) < kMaxBearingOffset)) {
    return fmt::format(
        "it fits only with a sensor turned by {:.0f} degrees: reversed odometry, or another "
        "mounting than the log says",
        offset * 180.0 / std::numbers::pi);
  }
  if (!IsScale(run.odometry.scale_v)) {
    return fmt::format("it fits only with speeds of {:.2f} times what odometry says",
                       run.odometry.scale_v);
  }
  if (!IsScale(run.odometry.scale_omega)) {
    return fmt::format("it fits only with yaw rates of {:.2f} times what odometry says",
                       run.odometry.scale_omega);
  }
  if (!(run.odometry.noise_omega < kMaxHeadingNoise)) {
    return fmt::format("it fits only if odometry loses the heading by {:.0f} degrees in a second",
                       run.odometry.noise_omega * 180.0 / std::numbers::pi);
  }
  return "";
}

}  // namespace shiftmap
