// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/sequential_test.h"

#include <algorithm>
#include <cmath>

#include "localizer/hypothesis/log_math.h"
#include "proto/core/check.h"

namespace shiftmap {

double DecisionThreshold(double alpha) {
  SHIFTMAP_CHECK(alpha > 0.0 && alpha < 0.5, "alpha {}", alpha);
  return std::log((1.0 - alpha) / alpha);
}

TestOutcome TestStates(const Eigen::VectorXd& scores, double threshold) {
  TestOutcome outcome;
  Eigen::Index best = 0;
  const double top = scores.maxCoeff(&best);
  double second = kLogZero;
  for (Eigen::Index i = 0; i < scores.size(); ++i) {
    if (i == best) continue;
    second = std::max(second, scores[i]);
    if (top - scores[i] > threshold) outcome.hopeless.push_back(static_cast<int>(i));
  }
  outcome.log_odds = top - second;
  if (outcome.log_odds > threshold) outcome.decided = static_cast<int>(best);
  return outcome;
}

}  // namespace shiftmap
