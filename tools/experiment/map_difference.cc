// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/map_difference.h"

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <set>

#include "tools/eval/map_error.h"

namespace shiftmap {
namespace {

// Modes this near to each other are one. [m]
constexpr double kSameModeM = 0.3;

const LandmarkGroup* Find(const std::vector<LandmarkGroup>& groups, const Signature& signature) {
  const auto found = std::lower_bound(
      groups.begin(), groups.end(), signature, [](const LandmarkGroup& a, const Signature& b) {
        return a.signature < b;
      });
  return found != groups.end() && found->signature == signature ? &*found : nullptr;
}

// Of a group: what the map says of the reference's states, and what it gives to others.
struct Counterpart {
  Eigen::VectorXd probabilities;
  double other = 0.0;
};

void CompareStates(const LandmarkGroup& reference,
                   const Counterpart& counterpart,
                   MapDifference* difference) {
  constexpr double kSure = 20.0 / 21.0;
  const Eigen::VectorXd& expected = reference.probabilities;
  const double variation =
      0.5 * ((expected - counterpart.probabilities).cwiseAbs().sum() + counterpart.other);
  difference->variation += variation;
  difference->variation_max = std::max(difference->variation_max, variation);
  Eigen::Index state = 0;
  if (expected.maxCoeff(&state) <= kSure) return;
  ++difference->sure;
  const double p = counterpart.probabilities(state);
  if (p < counterpart.probabilities.maxCoeff() || p < counterpart.other) ++difference->other_state;
}

}  // namespace

StatusOr<MapDifference> CompareMaps(const std::vector<LandmarkGroup>& reference,
                                    const std::vector<LandmarkGroup>& map) {
  std::vector<TruePlace> places;
  for (const LandmarkGroup& group : reference) {
    for (const Mode& mode : group.modes) places.push_back({group.signature, mode.p_map_landmark});
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapError fit, EvaluateMap(map, places, /*align=*/true));
  MapDifference difference;
  double squares = 0.0;
  for (const LandmarkGroup& group : reference) {
    ++difference.groups;
    const LandmarkGroup* other = Find(map, group.signature);
    Counterpart counterpart{Eigen::VectorXd::Zero(group.chain.states())};
    std::set<int> matched = {0};  // States of the map.
    if (other != nullptr) counterpart.probabilities(0) = other->probabilities(0);
    for (std::size_t i = 0; i < group.modes.size(); ++i) {
      ++difference.modes;
      int nearest = -1;
      double distance = kSameModeM;
      for (std::size_t k = 0; other != nullptr && k < other->modes.size(); ++k) {
        const double of_mode =
            (fit.T_truth_map * other->modes[k].p_map_landmark - group.modes[i].p_map_landmark)
                .norm();
        if (of_mode >= distance || matched.contains(static_cast<int>(k) + 1)) continue;
        distance = of_mode;
        nearest = static_cast<int>(k) + 1;
      }
      if (nearest < 0) {
        ++difference.missing_modes;
        continue;
      }
      matched.insert(nearest);
      counterpart.probabilities(static_cast<Eigen::Index>(i) + 1) = other->probabilities(nearest);
      squares += distance * distance;
      difference.position_max_m = std::max(difference.position_max_m, distance);
    }
    if (other != nullptr) {
      difference.added_modes += other->chain.states() - static_cast<int>(matched.size());
      const double rate = group.chain.leave_rate_per_s();
      const double other_rate = other->chain.leave_rate_per_s();
      if (rate > 0.0 && other_rate > 0.0) {
        difference.log_rate_ratios.push_back(std::log(other_rate / rate));
      }
    }
    counterpart.other = 1.0 - counterpart.probabilities.sum();
    CompareStates(group, counterpart, &difference);
  }
  const int both = difference.modes - difference.missing_modes;
  difference.position_rms_m = std::sqrt(squares / std::max(1, both));
  difference.variation /= std::max(1, difference.groups);
  return difference;
}

}  // namespace shiftmap
