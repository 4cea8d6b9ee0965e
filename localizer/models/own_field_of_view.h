// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "mapstore/map/calibration.h"

namespace shiftmap {

/// The part of a sensor's field of view in which one vehicle has itself seen landmarks so far.
///
/// A map has one field of view, that of the vehicles that see farthest. Beyond its own a vehicle
/// sees nothing whatever stands there, so that silence there tells nothing.
///
/// Memory: fixed. Threads: const-safe.
class OwnFieldOfView {
 public:
  /// Nothing has been seen: a field of view of range 0.
  explicit OwnFieldOfView(const SensorCalibration& sensor);

  /// That of the sensor, whatever is seen.
  static OwnFieldOfView Whole(const SensorCalibration& sensor);

  /// A landmark was seen.
  /// @param q  Vehicle frame. [m]
  void Add(const Eigen::Vector2d& q);

  /// The sensor with the field of view that holds 99 % of what was seen. Limits are multiples of a
  /// fiftieth of the sensor's, rounded up, and never larger than those.
  const SensorCalibration& sensor() const { return own_; }

  /// It is the sensor's.
  bool IsWhole() const { return whole_; }

 private:
  static constexpr std::size_t kBins = 50;

  // Values in equal bins up to a limit, the last one open.
  class Histogram {
   public:
    explicit Histogram(double limit) : limit_(limit) {}

    double limit() const { return limit_; }

    void Add(double value);

    // The least upper edge of a bin that at most `count` values are beyond.
    double AllBut(std::int64_t count) const;

   private:
    double limit_;
    std::array<std::int64_t, kBins> counts_{};
  };

  SensorCalibration own_;
  Histogram ranges_;
  Histogram bearings_;
  std::int64_t seen_ = 0;
  bool whole_ = false;
  bool learns_ = true;
};

}  // namespace shiftmap
