// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/innovation_quality.h"

#include <cmath>
#include <numeric>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Correlation of two terms of a window: measured on simulated shifts.
constexpr double kCorrelation = 0.012;

}  // namespace

void InnovationQuality::Add(double nis) { window_.push_back(nis); }

double InnovationQuality::p_value() const {
  if (window_.size() < kWindow) return 1.0;
  const double sum = std::accumulate(window_.begin(), window_.end(), 0.0);
  const double c = 1.0 + (kWindow - 1) * kCorrelation;
  const auto dof = static_cast<int>(std::lround(2.0 * kWindow / c));
  // The rounded degrees of freedom keep the mean.
  return ChiSquareTail(sum * dof / (2.0 * kWindow), dof);
}

}  // namespace shiftmap
