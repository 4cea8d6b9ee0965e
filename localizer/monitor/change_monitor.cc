// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/change_monitor.h"

#include <algorithm>

namespace shiftmap {
namespace {

// A pose that went wrong is found out in this time; until then nothing is a change.
constexpr double kMinDoubtS = 3.0;

// How long ago others must have agreed with the pose.
constexpr double kRecentS = 2.0;

}  // namespace

void ChangeMonitor::Explained(int group) {
  failures_[static_cast<std::size_t>(group)].count = 0;
  std::erase_if(gone_, [&](const Doubt& doubt) { return doubt.group == group; });
}

std::optional<PoseSupport> ChangeMonitor::Sighted(int group,
                                                  const SightingCollector::PlaceState& place,
                                                  const HealthMonitor& health) {
  Failures& failures = failures_[static_cast<std::size_t>(group)];
  if (failures.count++ == 0) failures.first = place.last;
  const Stamp first = std::max(place.first, failures.first);
  if (failures.count < min_sightings_ || place.count < min_sightings_ || !place.from_apart ||
      ToSeconds(place.last - first) < kMinDoubtS) {
    return std::nullopt;
  }
  return Support(group, first, place.last, health);
}

std::optional<PoseSupport> ChangeMonitor::Support(int group,
                                                  Stamp first,
                                                  Stamp now,
                                                  const HealthMonitor& health) const {
  const PoseSupport support = health.Support(first, group);
  if (!support.Confirms()) return std::nullopt;
  if (!health.Support(now - FromSeconds(kRecentS), group).Agrees()) return std::nullopt;
  return support;
}

void ChangeMonitor::Decided(int group, bool absent, Stamp stamp) {
  std::erase_if(gone_, [&](const Doubt& doubt) { return doubt.group == group; });
  if (absent) gone_.push_back({group, stamp});
}

std::optional<ChangeMonitor::Gone> ChangeMonitor::TakeGone(const HealthMonitor& health, Stamp now) {
  for (std::size_t i = 0; i < gone_.size(); ++i) {
    if (ToSeconds(now - gone_[i].stamp) < kMinDoubtS) continue;
    const auto support = Support(gone_[i].group, gone_[i].stamp, now, health);
    if (!support) continue;
    const Gone gone{gone_[i].group, *support};
    gone_.erase(gone_.begin() + static_cast<std::ptrdiff_t>(i));
    return gone;
  }
  return std::nullopt;
}

void ChangeMonitor::Reset() {
  std::fill(failures_.begin(), failures_.end(), Failures());
  gone_.clear();
}

}  // namespace shiftmap
