// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/localizer_flags.h"

#include "mapstore/core/magnitude.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap {

void AddLimitOptions(Command* command, LimitOptions* limits) {
  constexpr double kMinLimit = 1e-3;
  command
      ->Option("--max-range-m",
               &limits->max_range_m,
               "Drop what is seen farther away; default: 1000, or ten times the sensor's range")
      .InRange(kMinLimit, kMaxMagnitude)
      .Option(
          "--max-speed-mps", &limits->max_speed_mps, "Drop odometry that is faster; default: 100")
      .InRange(kMinLimit, kMaxMagnitude)
      .Option("--max-yaw-rate-radps",
              &limits->max_yaw_rate_radps,
              "Drop odometry that turns faster; default: 50")
      .InRange(kMinLimit, kMaxMagnitude);
}

std::string CheckVehicleName(const std::string& vehicle) {
  const Status status = CheckReportText("--vehicle", vehicle);
  return status.ok() ? "" : Message(status);
}

}  // namespace shiftmap
