// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>

#include "localizer/models/detection_model.h"
#include "mapstore/map/calibration.h"

namespace shiftmap {

/// The sector in which one vehicle has itself seen landmarks.
///
/// A map has one field of view, that of the vehicles that see farthest, and ahead. Beyond its own,
/// which may be to one side or to the rear, a vehicle sees nothing whatever stands there, so that
/// silence there tells nothing.
///
/// Memory: fixed. Threads: const-safe.
class OwnFieldOfView {
 public:
  /// Nothing has been seen.
  explicit OwnFieldOfView(const SensorCalibration& sensor) : max_range_m_(sensor.max_range_m) {}

  /// A landmark was seen in another view than before.
  /// @param q  Vehicle frame. [m]
  void Add(const Eigen::Vector2d& q);

  /// Holds 99 % of the landmarks seen by range, and by bearing. Range in steps of a fiftieth of the
  /// sensor's, rounded up, and not more than that; bearings in steps of 1.4 degrees, with half a
  /// step on either side. Of range 0 if nothing has been seen. Cost: some hundred additions.
  Sector MakeSector() const;

 private:
  static constexpr std::size_t kRanges = 50;
  static constexpr std::size_t kBearings = 256;

  // All but the longest arc in which at most `beyond` were seen.
  void SetBearings(int beyond, Sector* sector) const;

  double max_range_m_;
  int seen_ = 0;
  std::array<int, kRanges> by_range_{};      // The last bin is open.
  std::array<int, kBearings> by_bearing_{};  // From -π on.
};

}  // namespace shiftmap
