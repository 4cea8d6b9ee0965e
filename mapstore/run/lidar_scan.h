// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <numbers>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A 2D lidar: n beams at equal steps, counter-clockwise, the first and the last at the ends of the
/// field of view, which is symmetric about the lidar's x axis.
struct LidarSensor {
  /// No lidar's beams reach further. [m]
  static constexpr double kMaxRangeM = 10'000.0;

  double field_of_view_rad = std::numbers::pi;  ///< In (0, 2π). [rad]

  /// A range that is not below this, or not above 0, is no return; in (0, kMaxRangeM]. [m]
  double max_range_m = 80.0;

  Se2 T_vehicle_lidar = {};  ///< How it is mounted.

  /// Direction of a beam in the lidar frame. Precondition: beams >= 2. [rad]
  double Bearing(std::size_t beam, std::size_t beams) const {
    return field_of_view_rad * (static_cast<double>(beam) / static_cast<double>(beams - 1) - 0.5);
  }

  /// True if the way from the last beam to the first is one step, as on the full circle.
  bool AllRound(std::size_t beams) const;

  bool Returned(double range_m) const { return range_m > 0.0 && range_m < max_range_m; }

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// What a 2D lidar measured in one sweep.
struct LidarScan {
  /// More are an error of the recorder.
  static constexpr std::size_t kMaxBeams = 10'000;

  Stamp stamp;
  LidarSensor sensor;

  /// By beam, in [0, LidarSensor::kMaxRangeM]. A run log keeps whole millimetres. [m]
  std::vector<float> ranges_m;
};

}  // namespace shiftmap
