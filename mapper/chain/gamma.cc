// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/gamma.h"

#include <algorithm>
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
  // In v = log x, Newton's method for the logarithm of the smaller tail, which is concave in v.
  const bool is_lower = probability < 0.5;
  const double log_tail = std::log(is_lower ? probability : 1.0 - probability);
  const double log_gamma = Eigen::numext::lgamma(shape);
  double low = std::log(shape) - 60.0 - 60.0 / shape;  // Far less than any probability.
  double high = std::log(shape + 40.0 * std::sqrt(shape) + 800.0);
  // P = x^shape / Γ(shape + 1) for small x, or the mean.
  double value = std::min((std::log(probability) + Eigen::numext::lgamma(shape + 1.0)) / shape,
                          std::log(shape + 1.0));
  for (int i = 0; i < 200 && high - low > 1e-12; ++i) {
    if (!(low < value && value < high)) value = 0.5 * (low + high);
    const double x = std::exp(value);
    double log_found = shape * value - log_gamma - std::log(shape);
    if (x > 1e-12) {
      log_found =
          std::log(is_lower ? Eigen::numext::igamma(shape, x) : Eigen::numext::igammac(shape, x));
    } else if (!is_lower) {
      log_found = std::log1p(-std::exp(log_found));
    }
    const bool is_below = is_lower == (log_found < log_tail);
    (is_below ? low : high) = value;
    const double log_density = shape * value - x - log_gamma;  // Of v.
    const double slope = std::exp(log_density - log_found) * (is_lower ? 1.0 : -1.0);
    const double next = value - (log_found - log_tail) / slope;
    if (std::abs(next - value) < 1e-11) break;
    value = next;
  }
  return std::exp(value) / exposure_s;
}

Gamma MixtureOf(const Gamma& first, const Gamma& second, double share) {
  const double apart = second.mean() - first.mean();
  const double mean = first.mean() + share * apart;
  const double variance = (1.0 - share) * first.mean() / first.exposure_s +
                          share * second.mean() / second.exposure_s +
                          share * (1.0 - share) * apart * apart;
  return {mean * mean / variance, mean / variance};
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
