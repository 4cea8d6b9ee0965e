// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/implausible_calibration.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>

#include "mapper/frontend/frame_motions.h"
#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

bool IsWithin(double factor, double scale) { return scale < factor && scale > 1.0 / factor; }

// Log odds that the vehicle turned, and that it drove, against odometry rather than with it, each
// step's difference with the most noise that a working vehicle has. A scale cannot say so: it has
// no sign, and what it does not explain becomes noise.
struct LogOddsOfReversal {
  double turns = 0.0;
  double ways = 0.0;
};

LogOddsOfReversal ReversalOf(const PlausibilityOptions& options, const BuildRun& run) {
  LogOddsOfReversal log_odds;
  for (const FrameIndex i : run.motions.between_frames.indices()) {
    if (!run.motions.between_frames[i].Measured()) continue;
    const double seconds = ToSeconds(run.data->frames[i + 1].stamp - run.data->frames[i].stamp);
    if (seconds <= 0.0) continue;  // Scans of one time.
    const Se2& odometry = run.motions.between_frames[i].T_begin_end;
    const Se2 moved = run.poses[i].Inverse() * run.poses[i + 1];
    const auto add = [&](double with, double against, double max_noise, double* sum) {
      *sum += (with * with - against * against) / (2.0 * max_noise * max_noise * seconds);
    };
    add(WrapAngle(moved.yaw() - odometry.yaw()),
        WrapAngle(moved.yaw() + odometry.yaw()),
        options.max_noise_omega,
        &log_odds.turns);
    add(moved.x() - odometry.x(), moved.x() + odometry.x(), options.max_noise_v, &log_odds.ways);
  }
  return log_odds;
}

}  // namespace

std::string ImplausibleCalibration(const PlausibilityOptions& options,
                                   const BuildRun& run,
                                   const SensorCalibration& sensor) {
  const double offset = std::remainder(run.sensor_bias[kBearingOffset], 2.0 * std::numbers::pi);
  if (!(std::abs(offset) < options.max_bearing_offset_rad)) {
    return fmt::format(
        "it fits only with a sensor turned by {:.0f} degrees: reversed odometry, or another "
        "mounting than the log says",
        offset * 180.0 / std::numbers::pi);
  }
  const LogOddsOfReversal reversal = ReversalOf(options, run);
  if (reversal.turns > options.reversed_log_odds) {
    return "it fits only if it turns the other way than odometry says: bearings or yaw rates of "
           "the wrong sign";
  }
  if (reversal.ways > options.reversed_log_odds) {
    return "it fits only if it drives the other way than odometry says: reversed odometry";
  }
  if (!IsWithin(options.max_scale, run.odometry.scale_v)) {
    return fmt::format(
        "it fits only with speeds of {:.2f} times what odometry says: {}",
        run.odometry.scale_v,
        run.odometry.scale_v < 1.0 ? "another unit, or reversed odometry" : "another unit");
  }
  if (!IsWithin(options.max_scale, run.odometry.scale_omega)) {
    return fmt::format("it fits only with yaw rates of {:.2f} times what odometry says",
                       run.odometry.scale_omega);
  }
  if (!(run.odometry.noise_omega < options.max_noise_omega)) {
    return fmt::format("it fits only if odometry loses the heading by {:.0f} degrees in a second",
                       run.odometry.noise_omega * 180.0 / std::numbers::pi);
  }
  if (!(sensor.sd_bearing_rad < options.max_sd_bearing_rad)) {
    return fmt::format("it fits only with bearings that are wrong by {:.0f} degrees: another unit",
                       sensor.sd_bearing_rad * 180.0 / std::numbers::pi);
  }
  return "";
}

}  // namespace shiftmap
