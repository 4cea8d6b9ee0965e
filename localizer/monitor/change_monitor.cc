// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/change_monitor.h"

#include <algorithm>

namespace shiftmap {
namespace {

// A pose that went wrong is found out in this time; until then nothing is a change.
constexpr double kMinDoubtS = 3.0;

}  // namespace

std::optional<PoseSupport> ChangeMonitor::Sighted(int group,
                                                  const SightingCollector::PlaceState& place,
                                                  const HealthMonitor& health) {
  const int failures = ++failures_[static_cast<std::size_t>(group)];
  if (failures < min_sightings_ || place.count < min_sightings_ || !place.from_apart ||
      ToSeconds(place.last - place.first) < kMinDoubtS) {
    return std::nullopt;
  }
  const PoseSupport support = health.Support(place.first, group);
  if (!support.Confirms()) return std::nullopt;
  return support;
}

void ChangeMonitor::Decided(int group, bool absent, Stamp stamp) {
  std::erase_if(gone_, [&](const Doubt& doubt) { return doubt.group == group; });
  if (absent) gone_.push_back({group, stamp});
}

std::optional<ChangeMonitor::Gone> ChangeMonitor::TakeGone(const HealthMonitor& health) {
  for (std::size_t i = 0; i < gone_.size(); ++i) {
    const PoseSupport support = health.Support(gone_[i].stamp, gone_[i].group);
    if (!support.Confirms()) continue;
    const Gone gone{gone_[i].group, support};
    gone_.erase(gone_.begin() + static_cast<std::ptrdiff_t>(i));
    return gone;
  }
  return std::nullopt;
}

void ChangeMonitor::Reset() {
  std::fill(failures_.begin(), failures_.end(), 0);
  gone_.clear();
}

}  // namespace shiftmap
