// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <limits>

namespace shiftmap {

inline constexpr double kLogZero = -std::numeric_limits<double>::infinity();

/// log(e^a + e^b); either may be -∞.
inline double LogAdd(double a, double b) {
  const double larger = std::max(a, b);
  const double smaller = std::min(a, b);
  if (smaller == kLogZero) return larger;
  return larger + std::log1p(std::exp(smaller - larger));
}

/// log Σ e^x_i; -∞ for nothing.
inline double LogSumExp(const Eigen::Ref<const Eigen::VectorXd>& x) {
  const double largest = x.size() == 0 ? kLogZero : x.maxCoeff();
  if (largest == kLogZero) return kLogZero;
  return largest + std::log((x.array() - largest).exp().sum());
}

}  // namespace shiftmap
