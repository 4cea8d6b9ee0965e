// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/paired_test.h"

#include <algorithm>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <vector>

namespace shiftmap {

PairedTestResult PairedTest(std::span<const double> differences, double margin) {
  constexpr double kMostLoss = 4.0;  // Margins.
  constexpr double kLevel = 0.05;
  constexpr double kPriorDof = 4.0;
  constexpr double kPriorShare = 0.25;  // Margins.
  PairedTestResult result;
  result.shifts = static_cast<int>(differences.size());
  result.margin = margin;
  if (differences.empty()) return result;
  const auto count = static_cast<double>(differences.size());
  std::vector<double> held(differences.begin(), differences.end());
  for (double& d : held) d = std::clamp(d, -margin, kMostLoss * margin);
  for (const double d : held) result.mean += d / count;
  const double prior_sd = kPriorShare * margin;
  double squares = kPriorDof * prior_sd * prior_sd;
  for (const double d : held) squares += (d - result.mean) * (d - result.mean);
  const double dof = count - 1.0 + kPriorDof;
  const double t = boost::math::quantile(boost::math::students_t_distribution<>(dof), 1.0 - kLevel);
  result.upper = result.mean + t * std::sqrt(squares / dof / count);
  return result;
}

}  // namespace shiftmap
