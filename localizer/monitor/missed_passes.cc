// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/missed_passes.h"

#include <algorithm>
#include <cmath>

namespace shiftmap {
namespace {

constexpr int kMinPasses = 3;  // One or two may be occlusions.

// A pass is missed when one would have failed to see what stands there with e⁻⁷, and a direction is
// when with e⁻³. [nat]
constexpr double kPassMissed = 7.0;
constexpr double kDirectionMissed = 3.0;

// Directions of 45 degrees in a row that need not be missed.
constexpr int kMaxGap = 3;

// Out of view for so long ends a pass. [s]
constexpr double kPassGapS = 5.0;

// A mode that is less likely need not have been missed.
constexpr double kUnlikely = 0.05;

// The map has it as absent: that it is missed is nothing new.
bool HeldAbsent(int group, const MapSnapshot& snapshot) {
  Eigen::Index likeliest = 0;
  snapshot.groups()[static_cast<std::size_t>(group)].probabilities.maxCoeff(&likeliest);
  return likeliest == 0;
}

}  // namespace

MissedPasses::MissedPasses(const MapSnapshot& snapshot) {
  std::size_t modes = 0;
  for (const LandmarkGroup& group : snapshot.groups()) modes += group.modes.size();
  misses_.resize(modes);
  stood_.resize(snapshot.groups().size());
}

std::vector<int> MissedPasses::Add(const Scan& scan,
                                   const HypothesisBank& bank,
                                   const MapSnapshot& snapshot) {
  std::vector<int> gone;
  const SensorCalibration& sensor = snapshot.calibration().sensor;
  const double log_miss = -std::log1p(-sensor.detection_probability);
  const Se2& T_map_vehicle = bank.best().filter.T_map_vehicle();
  const Se2 T_vehicle_map = T_map_vehicle.Inverse();
  for (const Visit& visit : bank.visits()) {
    const auto group = static_cast<std::size_t>(visit.group);
    if (visit.decided.value_or(0) != 0) stood_[group] = true;
    if (visit.seen) {
      Seen(visit.group, scan.stamp, snapshot);
      continue;
    }
    const auto& modes = snapshot.groups()[group].modes;
    bool complete = false;
    for (std::size_t i = 0; i < modes.size(); ++i) {
      const Eigen::Vector2d& p = modes[i].p_map_landmark;
      if (!bank.field_of_view().WellInView(T_vehicle_map * p)) continue;
      Misses& misses = Of(visit.group, static_cast<int>(i) + 1, snapshot);
      complete |= Missed(p - T_map_vehicle.translation(), log_miss, scan.stamp, &misses);
    }
    const bool known = HeldAbsent(visit.group, snapshot) && !stood_[group];
    if (complete && !known && NoOtherIsLikely(visit.group, bank, snapshot)) {
      gone.push_back(visit.group);
    }
  }
  return gone;
}

void MissedPasses::Seen(int group, Stamp stamp, const MapSnapshot& snapshot) {
  const auto& modes = snapshot.groups()[static_cast<std::size_t>(group)].modes;
  for (std::size_t i = 0; i < modes.size(); ++i) {
    Misses seen;
    seen.seen_in_pass = true;
    seen.in_view = stamp;
    Of(group, static_cast<int>(i) + 1, snapshot) = seen;
  }
}

bool MissedPasses::Missed(const Eigen::Vector2d& view,
                          double log_miss,
                          Stamp stamp,
                          Misses* misses) {
  const bool first = misses->in_view == Stamp::min();
  if (first || ToSeconds(stamp - misses->in_view) > kPassGapS) {
    misses->in_pass = 0.0;
    misses->seen_in_pass = false;
  }
  misses->in_view = stamp;
  if (misses->seen_in_pass) return false;
  const double turn = std::atan2(view.y(), view.x()) / (2.0 * M_PI) + 0.5;
  const auto direction = static_cast<std::size_t>(turn * kDirections) % kDirections;
  misses->from[direction] += log_miss;
  const bool counted_before = misses->in_pass >= kPassMissed;
  misses->in_pass += log_miss;
  const bool counts = !counted_before && misses->in_pass >= kPassMissed;
  if (counts) ++misses->passes;
  return counts && Complete(*misses);
}

bool MissedPasses::FromAllAround(const Misses& misses) {
  int gap = 0;
  for (std::size_t i = 0; i < 2 * kDirections; ++i) {
    gap = misses.from[i % kDirections] >= kDirectionMissed ? 0 : gap + 1;
    if (gap > kMaxGap) return false;
  }
  return true;
}

bool MissedPasses::Complete(const Misses& misses) {
  return misses.passes >= kMinPasses && FromAllAround(misses);
}

bool MissedPasses::NoOtherIsLikely(int group,
                                   const HypothesisBank& bank,
                                   const MapSnapshot& snapshot) {
  const Eigen::VectorXd probabilities = bank.Probabilities(group);
  for (int state = 1; state < probabilities.size(); ++state) {
    if (probabilities[state] > kUnlikely && !Complete(Of(group, state, snapshot))) return false;
  }
  return true;
}

void MissedPasses::Reset() {
  std::fill(misses_.begin(), misses_.end(), Misses());
  stood_.assign(stood_.size(), false);
}

}  // namespace shiftmap
