// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/vehicle_records.h"

#include <algorithm>

namespace shiftmap {
namespace {

constexpr double kMistakesOfWorking = 0.5 * kMistakeProbability;
constexpr double kMistakesOfBroken = 0.9;
constexpr double kBroken =
    (kMistakeProbability - kMistakesOfWorking) / (kMistakesOfBroken - kMistakesOfWorking);
constexpr double kChange = 0.01;  // From verdict to verdict.

// One turn says no more.
constexpr double kMaxBayesFactor = 1e12;

}  // namespace

double VehicleRecords::MistakeProbability(std::int64_t vehicle) const {
  const auto found = broken_.find(vehicle);
  if (found == broken_.end()) return kMistakeProbability;
  return kMistakesOfWorking + found->second * (kMistakesOfBroken - kMistakesOfWorking);
}

void VehicleRecords::Add(const TurnVerdict& verdict) {
  double& broken = broken_.try_emplace(verdict.vehicle, kBroken).first->second;
  broken -= kChange * (broken - kBroken);
  const double factor = std::min(verdict.bayes_factor, kMaxBayesFactor);
  const double if_broken = 1.0 - kMistakesOfBroken + kMistakesOfBroken * factor;
  const double if_working = 1.0 - kMistakesOfWorking + kMistakesOfWorking * factor;
  const double odds = broken / (1.0 - broken) * if_broken / if_working;
  broken = odds / (1.0 + odds);
}

}  // namespace shiftmap
