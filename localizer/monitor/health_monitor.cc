// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/health_monitor.h"

#include <algorithm>
#include <cmath>

#include "localizer/monitor/innovation_quality.h"

namespace shiftmap {
namespace {

constexpr int kMinFailing = 3;   // Landmarks: fewer may have moved.
constexpr int kMinAgreeing = 3;  // Landmarks: two agree by accident.

// Share of the landmarks in view that may have moved.
constexpr double kMovedShare = 1.0 / 3.0;

// A landmark that agreed so long before it fails turned.
constexpr double kTurnS = 10.0;

// Unproven: of the landmarks seen in this time [s], at most two stand where the map has them, and
// as many do not as have moved at once with less than this probability (FailureTail).
constexpr double kUnprovenS = 60.0;
constexpr double kUnprovenTail = 0.01;

// Least chance of the innovations by which a pose is confirmed.
constexpr double kMinTail = 0.02;

}  // namespace

bool PoseSupport::Confirms() const {
  return agreeing >= kMinAgreeing && agreeing >= 2 + 2 * failing;
}

bool PoseSupport::Agrees() const {
  return agreeing > failing && updates >= agreeing && InnovationTail(nis_sum, updates) > kMinTail;
}

bool PoseSupport::Doubts() const { return failing >= kMinFailing && 3 * agreeing <= failing; }

double FailureTail(const PoseSupport& support) {
  const int seen = support.agreeing + support.failing;
  double term = std::pow(1.0 - kMovedShare, seen);
  double tail = 1.0;
  for (int failing = 0; failing < support.failing; ++failing) {
    tail -= term;
    term *= kMovedShare / (1.0 - kMovedShare) * (seen - failing) / (failing + 1);
  }
  return std::max(tail, 0.0);
}

void HealthMonitor::Add(
    Stamp stamp, int group, bool explained, std::optional<double> nis, bool vague) {
  LastSeen& last = last_[static_cast<std::size_t>(group)];
  if (last.stamp != Stamp::min()) --(last.explained ? all_.agreeing : all_.failing);
  ++(explained ? all_.agreeing : all_.failing);
  last.stamp = stamp;
  last.explained = explained;
  last.at_mode = nis.has_value();
  if (explained && !vague) last.agreed = stamp;
  Tally& tally = TallyAt(stamp);
  ++(explained ? tally.explained : tally.failed);
  if (!nis) return;
  tally.nis_sum += *nis;
  ++tally.updates;
}

void HealthMonitor::AddPairs(Stamp stamp, const FailingPairs& pairs) {
  if (pairs.pairs > 0) TallyAt(stamp).pairs = pairs;
}

HealthMonitor::Tally& HealthMonitor::TallyAt(Stamp stamp) {
  if (tallies_.empty() || tallies_.back().stamp != stamp) {
    tallies_.push_back({});
    tallies_.back().stamp = stamp;
  }
  return tallies_.back();
}

HealthMonitor::Tallies::const_iterator HealthMonitor::StretchBegin(double seconds,
                                                                   int observations) const {
  int seen = 0;
  for (auto it = tallies_.end(); it != tallies_.begin();) {
    --it;
    seen += it->explained + it->failed;
    const bool long_enough = ToSeconds(tallies_.back().stamp - it->stamp) >= seconds ||
                             (it == tallies_.begin() && tallies_.full());
    if (seen >= observations && long_enough) return it;
  }
  return tallies_.end();
}

double HealthMonitor::ExplainedShare(Tallies::const_iterator begin) const {
  int explained = 0;
  int seen = 0;
  for (auto it = begin; it != tallies_.end(); ++it) {
    explained += it->explained;
    seen += it->explained + it->failed;
  }
  return static_cast<double>(explained) / seen;
}

void HealthMonitor::Judge() {
  unproven_ = JudgeProof();
  if (lost_) {
    const auto begin = StretchBegin(0.0, options_.min_observations);
    // Two landmarks agree with some pose, always.
    lost_ = begin == tallies_.end() || begin->stamp < failing_since_ ||
            ExplainedShare(begin) < options_.found_share ||
            Support(begin->stamp, -1).agreeing < kMinAgreeing;
    return;
  }
  auto begin = StretchBegin(options_.lost_s, options_.min_observations);
  if (begin == tallies_.end() || ExplainedShare(begin) > options_.lost_share) return;
  if (!Support(begin->stamp, -1).Doubts() || LandmarksMoved(begin)) return;
  while (begin != tallies_.begin() && (begin - 1)->explained == 0) --begin;
  DeclareLost(begin->stamp);
  wrong_ = false;
}

void HealthMonitor::DeclareLost(Stamp since) {
  lost_ = true;
  wrong_ = true;
  failing_since_ = since;
}

bool HealthMonitor::LandmarksMoved(Tallies::const_iterator begin) const {
  FailingPairs sum;
  for (auto it = begin; it != tallies_.end(); ++it) {
    sum.as_in_map += it->pairs.as_in_map;
    sum.pairs += it->pairs.pairs;
  }
  return sum.pairs >= options_.min_pairs && sum.as_in_map < options_.min_pair_share * sum.pairs;
}

std::optional<PoseSupport> HealthMonitor::JudgeProof() const {
  if (tallies_.empty()) return std::nullopt;
  PoseSupport support;
  support.since = tallies_.back().stamp - FromSeconds(kUnprovenS);
  const AtModes seen = CountAtModes(support.since);
  support.agreeing = seen.yes + seen.of_start;
  support.failing = seen.no;
  // Two landmarks agree with some pose, always.
  if (support.agreeing >= kMinAgreeing) return std::nullopt;
  return FailureTail(support) < kUnprovenTail ? std::optional(support) : std::nullopt;
}

void HealthMonitor::MarkStart() {
  for (LastSeen& seen : last_) seen.of_start = seen.at_mode;
}

HealthMonitor::AtModes HealthMonitor::CountAtModes(Stamp since) const {
  AtModes count;
  for (const LastSeen& seen : last_) {
    if (seen.stamp == Stamp::min() || seen.stamp < since) continue;
    ++(!seen.at_mode ? count.no : seen.of_start ? count.of_start : count.yes);
  }
  return count;
}

PoseSupport HealthMonitor::Support(Stamp since, int except) const {
  PoseSupport support;
  support.since = since;
  for (std::size_t group = 0; group < last_.size(); ++group) {
    const LastSeen& seen = last_[group];
    if (seen.stamp == Stamp::min() || seen.stamp < since || static_cast<int>(group) == except) {
      continue;
    }
    ++(seen.explained ? support.agreeing : support.failing);
    const bool agreed = seen.agreed != Stamp::min() && ToSeconds(seen.stamp - seen.agreed) < kTurnS;
    support.turned += !seen.explained && agreed;
  }
  bool first = true;
  for (const Tally& tally : tallies_) {
    if (tally.stamp < since) continue;
    if (first) support.since = tally.stamp;
    first = false;
    support.nis_sum += tally.nis_sum;
    support.updates += tally.updates;
  }
  return support;
}

bool HealthMonitor::Confirms() const { return all_.Confirms(); }

void HealthMonitor::Reset() {
  all_ = {};
  std::fill(last_.begin(), last_.end(), LastSeen());
  tallies_.clear();
  lost_ = false;
  unproven_.reset();
}

}  // namespace shiftmap
