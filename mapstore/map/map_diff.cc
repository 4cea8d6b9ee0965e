// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_diff.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>

#include "mapstore/geometry/covariance.h"
#include "mapstore/map/move_rate.h"

namespace shiftmap {
namespace {

MovedMode Move(const Mode& from, const Mode& to) {
  MovedMode moved;
  moved.number = from.number;
  moved.displacement_m = to.p_map_landmark - from.p_map_landmark;
  moved.squared_mahalanobis =
      SquaredMahalanobis(moved.displacement_m, from.cov_p_map_landmark + to.cov_p_map_landmark);
  moved.p_value = ChiSquareTail(moved.squared_mahalanobis, 2);
  return moved;
}

// False if another number of modes makes the matrix another one by itself.
bool RatesChanged(const ModeChain& from, const ModeChain& to) {
  const bool rhythms = from.rhythm() != nullptr && to.rhythm() != nullptr;
  if (rhythms ? *from.rhythm() != *to.rhythm() : from.rhythm() != to.rhythm()) return true;
  if (from.uniform() && to.uniform()) return from.leave_rate_per_s() != to.leave_rate_per_s();
  return from.states() == to.states() && from.rate_matrix() != to.rate_matrix();
}

bool SameAnonymous(const std::vector<Mode>& from, const std::vector<Mode>& to) {
  return std::equal(
      from.begin(), from.end(), to.begin(), to.end(), [](const auto& a, const auto& b) {
        return a.number == b.number && a.p_map_landmark == b.p_map_landmark &&
               a.cov_p_map_landmark == b.cov_p_map_landmark;
      });
}

double ProbabilityChange(const LandmarkGroup& from, const LandmarkGroup& to) {
  std::map<ModeNumber, double> change;
  for (int state = 0; state < static_cast<int>(from.probabilities.size()); ++state) {
    const ModeNumber number = from.NumberOf(state);
    const int now = to.CarriedStateOf(number);
    change[now < 0 ? number : to.NumberOf(now)] -= from.probabilities(state);
  }
  for (int state = 0; state < static_cast<int>(to.probabilities.size()); ++state) {
    change[to.NumberOf(state)] += to.probabilities(state);
  }
  double sum = 0.0;
  for (const auto& [number, difference] : change) sum += std::abs(difference);
  return 0.5 * sum;
}

GroupDiff DiffGroup(const LandmarkGroup& from, const LandmarkGroup& to) {
  GroupDiff diff;
  diff.signature = from.signature;
  for (const Mode& mode : from.modes) {
    const int state = to.StateOf(mode.number);
    if (state >= 1) {
      const Mode& now = to.modes[static_cast<std::size_t>(state) - 1];
      const MovedMode moved = Move(mode, now);
      if (now.cov_p_map_landmark != mode.cov_p_map_landmark) diff.uncertainty_changed = true;
      if (!moved.displacement_m.isZero(0.0)) diff.moved.push_back(moved);
      continue;
    }
    const auto merged = std::find_if(to.merged.begin(), to.merged.end(), [&](const auto& other) {
      return other.number == mode.number;
    });
    if (merged == to.merged.end()) {
      diff.removed.push_back(mode.number);
    } else {
      diff.merged.push_back(*merged);
    }
  }
  for (const Mode& mode : to.modes) {
    if (from.StateOf(mode.number) < 0) diff.added.push_back(mode.number);
  }
  diff.from_move_rate_per_s = MoveRate(from.chain);
  diff.to_move_rate_per_s = MoveRate(to.chain);
  diff.rates_changed = RatesChanged(from.chain, to.chain);
  diff.probability_change = ProbabilityChange(from, to);
  return diff;
}

template <std::size_t kValues>
void AddChanges(const std::string& vehicle,
                const std::array<const char*, kValues>& names,
                const std::array<double, kValues>& from,
                const std::array<double, kValues>& to,
                MapDiff* diff) {
  for (std::size_t i = 0; i < kValues; ++i) {
    if (from[i] == to[i]) continue;
    diff->calibration.push_back({vehicle, names[i], from[i], to[i]});
  }
}

void DiffVehicles(const std::vector<VehicleCalibration>& from,
                  const std::vector<VehicleCalibration>& to,
                  MapDiff* diff) {
  auto a = from.begin();
  auto b = to.begin();
  while (a != from.end() || b != to.end()) {
    if (b == to.end() || (a != from.end() && a->vehicle < b->vehicle)) {
      diff->vehicles_removed.push_back((a++)->vehicle);
    } else if (a == from.end() || b->vehicle < a->vehicle) {
      diff->vehicles_added.push_back((b++)->vehicle);
    } else {
      AddChanges(a->vehicle, kVehicleValueNames, VehicleValues(*a), VehicleValues(*b), diff);
      ++a;
      ++b;
    }
  }
}

}  // namespace

MapDiff DiffMaps(const MapContent& from, const MapContent& to) {
  MapDiff diff;
  auto a = from.groups.begin();
  auto b = to.groups.begin();
  while (a != from.groups.end() || b != to.groups.end()) {
    if (b == to.groups.end() || (a != from.groups.end() && a->signature < b->signature)) {
      diff.groups_removed.push_back((a++)->signature);
    } else if (a == from.groups.end() || b->signature < a->signature) {
      diff.groups_added.push_back((b++)->signature);
    } else {
      GroupDiff group = DiffGroup(*a++, *b++);
      if (!group.empty()) diff.groups.push_back(std::move(group));
    }
  }
  diff.anonymous_from = static_cast<int>(from.anonymous_landmarks.size());
  diff.anonymous_to = static_cast<int>(to.anonymous_landmarks.size());
  diff.anonymous_changed = !SameAnonymous(from.anonymous_landmarks, to.anonymous_landmarks);
  AddChanges("",
             kCalibrationNames,
             CalibrationValues(from.calibration),
             CalibrationValues(to.calibration),
             &diff);
  DiffVehicles(from.vehicles, to.vehicles, &diff);
  return diff;
}

}  // namespace shiftmap
