// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/smooth_odometry.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>

#include "mapstore/core/median.h"
#include "mapstore/core/stamp.h"

namespace shiftmap {
namespace {

struct WeightedSum {
  double sum = 0.0;
  double weight = 0.0;
};

// Of the others about each value k: with the weights ρ^(|j - k| - 1).
std::vector<WeightedSum> SumsOfOthers(const std::vector<double>& values, double decay) {
  std::vector<WeightedSum> others(values.size());
  WeightedSum side;
  const auto pass = [&](std::size_t k) {
    others[k].sum += side.sum;
    others[k].weight += side.weight;
    side = {decay * side.sum + values[k], decay * side.weight + 1.0};
  };
  for (std::size_t k = 0; k < values.size(); ++k) pass(k);
  side = {};
  for (std::size_t k = values.size(); k-- > 0;) pass(k);
  return others;
}

double SquaredErrors(const std::vector<double>& values, const std::vector<WeightedSum>& others) {
  double sum = 0.0;
  for (std::size_t k = 0; k < values.size(); ++k) {
    const double error = values[k] - others[k].sum / others[k].weight;
    sum += error * error;
  }
  return sum;
}

void Smooth(double OdometrySample::*velocity, std::vector<OdometrySample>* odometry) {
  constexpr int kGrid = 13;  // 1 - ρ = 1, 1/2, 1/4, ... 1/4096.
  std::vector<double> values;
  for (const OdometrySample& sample : *odometry) values.push_back(sample.*velocity);
  double least = std::numeric_limits<double>::infinity();
  for (int i = 0; i < kGrid; ++i) {
    const double decay = 1.0 - std::ldexp(1.0, -i);
    const std::vector<WeightedSum> others = SumsOfOthers(values, decay);
    const double squared_errors = SquaredErrors(values, others);
    if (squared_errors >= least) continue;
    least = squared_errors;
    for (std::size_t k = 0; k < values.size(); ++k) {
      (*odometry)[k].*velocity =
          (values[k] + decay * others[k].sum) / (1.0 + decay * others[k].weight);
    }
  }
}

}  // namespace

std::vector<OdometrySample> SmoothOdometry(const std::vector<OdometrySample>& odometry) {
  std::vector<OdometrySample> smooth = odometry;
  if (odometry.size() < 2) return smooth;
  Smooth(&OdometrySample::v_mps, &smooth);
  Smooth(&OdometrySample::omega_radps, &smooth);
  return smooth;
}

double SamplePeriod(const std::vector<OdometrySample>& odometry) {
  std::vector<Duration> periods = {FromSeconds(1e-6)};
  for (std::size_t k = 1; k < odometry.size(); ++k) {
    periods.push_back(odometry[k].stamp - odometry[k - 1].stamp);
  }
  return std::max(1e-6, ToSeconds(Median(std::move(periods))));
}

}  // namespace shiftmap
