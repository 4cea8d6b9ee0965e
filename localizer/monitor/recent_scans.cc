// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/recent_scans.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {

RecentScans::RecentScans(std::optional<Spacing> spacing) : spacing_(spacing), scans_(kScans) {
  constexpr std::size_t kObservations = 32;
  for (WindowScan& scan : scans_) scan.scan.observations.reserve(kObservations);
}

// By the motion since the one that was kept before it.
bool RecentScans::FarFromTheLast(const WindowScan& newest) const {
  const Se2& moved = newest.motion.increment.T_begin_end;
  return newest.motion.elapsed_s >= spacing_->time_s &&
         (moved.translation().norm() >= spacing_->distance_m ||
          std::abs(moved.yaw()) >= spacing_->turn_rad);
}

void RecentScans::Add(const WindowScan& scan) {
  if (!spacing_) {
    scans_[next_] = scan;
  } else if (size_ > 1 && !FarFromTheLast(OfAge(0))) {
    WindowScan& newest = scans_[(next_ + kScans - 1) % kScans];
    newest.scan = scan.scan;
    newest.motion.increment = Compose(newest.motion.increment, scan.motion.increment);
    newest.motion.elapsed_s += scan.motion.elapsed_s;
    return;
  } else {
    scans_[next_].scan = scan.scan;
    scans_[next_].motion = scan.motion;
  }
  next_ = (next_ + 1) % kScans;
  size_ = std::min(size_ + 1, kScans);
}

std::vector<WindowScan> RecentScans::Since(Stamp since) const {
  std::size_t count = 0;
  while (count < size_ && OfAge(count).scan.stamp >= since) ++count;
  std::vector<WindowScan> scans;
  for (std::size_t age = count; age > 0; --age) scans.push_back(OfAge(age - 1));
  return scans;
}

}  // namespace shiftmap
