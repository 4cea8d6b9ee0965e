// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "localizer/initialization/sighting_clusters.h"

namespace shiftmap {

/// The last scans with the motion between them: all of them; or the newest and, before it, scans
/// that are apart from each other, without lidar.
///
/// Memory: 64 scans with room for 32 observations each, made at once; for more where there were
/// more.
class RecentScans {
 public:
  /// Two scans are apart if they are so by time, and by distance or by turn.
  struct Spacing {
    double time_s = 0.0;
    double distance_m = 0.0;
    double turn_rad = 0.0;
  };
  explicit RecentScans(std::optional<Spacing> spacing = std::nullopt);

  void Add(const WindowScan& scan);
  void Clear() { size_ = 0; }

  /// Of the oldest.
  std::optional<Stamp> Begin() const {
    return size_ == 0 ? std::nullopt : std::optional(OfAge(size_ - 1).scan.stamp);
  }

  /// Those from `since` on, oldest first.
  std::vector<WindowScan> Since(Stamp since) const;

 private:
  static constexpr std::size_t kScans = 64;

  // The newest has the age 0.
  const WindowScan& OfAge(std::size_t age) const {
    return scans_[(next_ + kScans - 1 - age) % kScans];
  }

  bool FarFromTheLast(const WindowScan& newest) const;

  std::optional<Spacing> spacing_;
  std::vector<WindowScan> scans_;
  std::size_t next_ = 0;
  std::size_t size_ = 0;
};

}  // namespace shiftmap
