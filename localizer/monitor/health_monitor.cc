// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/health_monitor.h"

#include <algorithm>
#include <set>

namespace shiftmap {
namespace {

constexpr std::size_t kWindow = 12;
constexpr double kLostShare = 0.25;
constexpr double kFoundShare = 0.5;
constexpr std::size_t kMinGroups = 3;

}  // namespace

void HealthMonitor::Add(int group, bool gated) {
  window_.push_back({group, gated});
  if (window_.size() > kWindow) window_.pop_front();
  if (window_.size() < kWindow) return;
  std::set<int> failing;
  for (const Outcome& outcome : window_) {
    if (!outcome.gated) failing.insert(outcome.group);
  }
  const double share = gated_share();
  if (share <= kLostShare && failing.size() >= kMinGroups) lost_ = true;
  if (share >= kFoundShare) lost_ = false;
}

double HealthMonitor::gated_share() const {
  if (window_.empty()) return 1.0;
  const auto gated = std::count_if(
      window_.begin(), window_.end(), [](const Outcome& outcome) { return outcome.gated; });
  return static_cast<double>(gated) / static_cast<double>(window_.size());
}

void HealthMonitor::Reset() {
  window_.clear();
  lost_ = false;
}

}  // namespace shiftmap
