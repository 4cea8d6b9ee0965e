// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/gamma.h"

#include <cmath>
#include <unsupported/Eigen/SpecialFunctions>

namespace shiftmap {
namespace {

// The zero of a function that does not fall, between `low` and `high`, to 1e-10; 200 halvings at
// most, since numbers beyond a million are farther from each other.
template <typename Function>
double Bisect(double low, double high, const Function& function) {
  for (int i = 0; i < 200 && high - low > 1e-10; ++i) {
    const double middle = 0.5 * (low + high);
    (function(middle) < 0.0 ? low : high) = middle;
  }
  return 0.5 * (low + high);
}

}  // namespace

double Gamma::MeanLog() const { return Eigen::numext::digamma(shape) - std::log(exposure_s); }

// std::lgamma writes a global, and threads would race for it.
double Gamma::LogDensityOfLog(double log_rate) const {
  return shape * (std::log(exposure_s) + log_rate) - exposure_s * std::exp(log_rate) -
         Eigen::numext::lgamma(shape);
}

double Gamma::Quantile(double probability) const {
  // In log x: below this, P = (exposure x)^shape / Γ(shape + 1) is far less than any probability.
  const double lowest = std::log(shape) - 60.0 - 60.0 / shape;
  const double highest = std::log(shape + 40.0 * std::sqrt(shape) + 800.0);
  const double log_scaled = Bisect(lowest, highest, [&](double value) {
    return Eigen::numext::igamma(shape, std::exp(value)) - probability;
  });
  return std::exp(log_scaled) / exposure_s;
}

Gamma GammaFromMeans(double mean, double mean_log) {
  const double gap = std::log(mean) - mean_log;
  // log a - ψ(a) falls from infinity to 0.
  const double log_shape = Bisect(std::log(0.01), std::log(1e6), [&](double value) {
    return gap - (value - Eigen::numext::digamma(std::exp(value)));
  });
  const double shape = std::exp(log_shape);
  return {shape, shape / mean};
}

}  // namespace shiftmap
