// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/input_options.h"

#include "mapstore/core/magnitude.h"

namespace shiftmap {

void AddLimitOptions(LimitOptions* limits, Command* command) {
  constexpr double kMinLimit = 1e-3;
  command
      ->Option("--max-range-m",
               &limits->max_range_m,
               "Drop observations of a greater range; default: 1000, or ten times the sensor's")
      .InRange(kMinLimit, kMaxMagnitude)
      .Option("--max-speed-mps",
              &limits->max_speed_mps,
              "Drop odometry of a greater speed; default: 100")
      .InRange(kMinLimit, kMaxMagnitude)
      .Option("--max-yaw-rate-radps",
              &limits->max_yaw_rate_radps,
              "Drop odometry of a greater yaw rate; default: 50")
      .InRange(kMinLimit, kMaxMagnitude);
}

void AddClockToleranceOption(double* value, Command* command) {
  command
      ->Option("--clock-tolerance-s",
               value,
               "Refuse what ends later than this host's clock and this [s]")
      .InRange(0.0, kMaxMagnitude);
}

}  // namespace shiftmap
