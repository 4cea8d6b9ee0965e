// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/health_monitor.h"

#include <algorithm>
#include <map>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Observations gone by for being lost.
constexpr std::size_t kLostWindow = 20;

constexpr double kLostShare = 0.2;
constexpr double kFoundShare = 0.5;
constexpr int kMinGroups = 3;

// Pairs that tell, and the share of them that keeps its distance where the pose is wrong.
constexpr int kMinPairs = 4;
constexpr double kMinPairShare = 0.6;

constexpr int kMinAgreeing = 3;

// Least chance of the innovations by which a pose is confirmed.
constexpr double kMinTail = 1e-3;

}  // namespace

bool PoseSupport::Confirms() const {
  return agreeing >= kMinAgreeing && agreeing >= 2 + 2 * failing && updates > 0 &&
         ChiSquareTail(nis_sum, 2 * updates) > kMinTail;
}

void HealthMonitor::Add(Stamp stamp, int group, bool explained, std::optional<double> nis) {
  window_.push_back({stamp, group, explained, nis});
  JudgeLost();
}

void HealthMonitor::JudgeLost() {
  if (window_.size() < kLostWindow) return;
  const auto begin = window_.end() - static_cast<std::ptrdiff_t>(kLostWindow);
  const auto explained =
      std::count_if(begin, window_.end(), [](const Outcome& outcome) { return outcome.explained; });
  const double share = static_cast<double>(explained) / static_cast<double>(kLostWindow);
  if (share >= kFoundShare) lost_ = false;
  if (lost_ || share > kLostShare) return;
  const PoseSupport support = Support(begin->stamp, -1);
  if (support.failing < kMinGroups || 3 * support.agreeing > support.failing) return;
  if (LandmarksMoved(begin->stamp)) return;
  lost_ = true;
  auto first = begin;
  while (first != window_.begin() && !(first - 1)->explained) --first;
  failing_since_ = first->stamp;
}

void HealthMonitor::AddPairs(Stamp stamp, int as_in_map, int pairs) {
  pairs_.push_back({stamp, as_in_map, pairs});
}

bool HealthMonitor::LandmarksMoved(Stamp since) const {
  int as_in_map = 0;
  int pairs = 0;
  for (const Pairs& scan : pairs_) {
    if (scan.stamp < since) continue;
    as_in_map += scan.as_in_map;
    pairs += scan.pairs;
  }
  return pairs >= kMinPairs && as_in_map < kMinPairShare * pairs;
}

PoseSupport HealthMonitor::Support(Stamp since, int except) const {
  std::map<int, bool> last;
  PoseSupport support;
  support.since = since;
  bool first = true;
  for (const Outcome& outcome : window_) {
    if (outcome.stamp < since || outcome.group == except) continue;
    if (first) support.since = outcome.stamp;
    first = false;
    last[outcome.group] = outcome.explained;
    if (!outcome.nis) continue;
    support.nis_sum += *outcome.nis;
    ++support.updates;
  }
  for (const auto& [group, explained] : last) ++(explained ? support.agreeing : support.failing);
  return support;
}

void HealthMonitor::Reset() {
  window_.clear();
  pairs_.clear();
  lost_ = false;
}

}  // namespace shiftmap
