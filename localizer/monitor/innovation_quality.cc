// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/innovation_quality.h"

#include <cmath>
#include <numeric>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

// Correlation of two terms of a sum: measured on simulated shifts.
constexpr double kCorrelation = 0.012;

}  // namespace

double InnovationTail(double nis_sum, int count) {
  const double c = 1.0 + (count - 1) * kCorrelation;
  const auto dof = static_cast<int>(std::lround(2.0 * count / c));
  // The rounded degrees of freedom keep the mean.
  return ChiSquareTail(nis_sum * dof / (2.0 * count), dof);
}

void InnovationQuality::Add(double nis) { window_.push_back(nis); }

double InnovationQuality::p_value() const {
  if (window_.empty()) return 1.0;
  return InnovationTail(std::accumulate(window_.begin(), window_.end(), 0.0),
                        static_cast<int>(window_.size()));
}

}  // namespace shiftmap
