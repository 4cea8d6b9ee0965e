// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/recent_scans.h"

#include <algorithm>

namespace shiftmap {

RecentScans::RecentScans() : scans_(kScans) {
  constexpr std::size_t kObservations = 32;
  for (WindowScan& scan : scans_) scan.scan.observations.reserve(kObservations);
}

void RecentScans::Add(const WindowScan& scan) {
  scans_[next_] = scan;
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
