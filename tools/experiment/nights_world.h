// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "proto/core/status.h"
#include "tools/experiment/vehicle_fault.h"
#include "tools/sim/open_world.h"

namespace shiftmap {

/// A site over some weeks: every vehicle drives one shift a day.
struct NightsOptions {
  std::uint64_t seed = 1;
  int nights = 30;
  int vehicles = 5;
  int groups = 30;
  double size_m = 40.0;
  double duration_s = 120.0;  ///< Of a shift.

  /// Every so many days, over noon, this share of all landmarks that ever move does so at once; 0
  /// days: never.
  int layout_days = 0;
  double layout_share = 0.6;

  int nights_per_build = 1;  ///< A build after every so many days, and after the last one.

  /// Whether a vehicle hands its report in at the end of its shift, else at night.
  bool return_at_once = false;

  /// Landmarks that never move and that somebody surveys after the first night, in the frame of its
  /// map; as many as there are, if they are fewer.
  int control_points = 0;

  /// The first vehicle has the fault for `fault_nights` from `fault_night` on.
  VehicleFault fault = VehicleFault::kNone;
  int fault_night = 6;
  int fault_nights = 0;
};

struct NightsWorld {
  SimulatedWorld world;  ///< Runs in the order of time, `vehicles` a day.

  /// By group: the first run in which it is gone for good; nothing if it never is.
  std::vector<std::optional<int>> removed;
};

/// Draws a site. A landmark has three places; a quarter of them never moves, half stay 15 days in
/// the mean at a place and a quarter 2 days; one move in ten ends away, for 3 days in the mean. One
/// landmark in ten is removed for good in the second third of the time.
/// Determinism: the same options give the same bits. Errors: as SimulateOpen.
StatusOr<NightsWorld> DrawNights(const NightsOptions& options);

}  // namespace shiftmap
