// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/sequential_test.h"

#include <cmath>

#include "localizer/hypothesis/log_math.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// What giving states up may add to the probability of a wrong decision: a hundredth of α each.
constexpr double kGiveUpMargin = 4.6;  // log 100

}  // namespace

double DecisionThreshold(double alpha) {
  SHIFTMAP_CHECK(alpha > 0.0 && alpha < 0.5, "alpha {}", alpha);
  return std::log((1.0 - alpha) / alpha);
}

TestOutcome TestStates(const Eigen::Ref<const Eigen::VectorXd>& scores, double threshold) {
  TestOutcome outcome;
  Eigen::Index best = 0;
  const double top = scores.maxCoeff(&best);
  double others = kLogZero;
  for (Eigen::Index i = 0; i < scores.size(); ++i) {
    if (i == best) continue;
    others = LogAdd(others, scores[i]);
    const bool rejected = top - scores[i] > threshold + kGiveUpMargin;
    if (rejected) outcome.rejected.push_back(static_cast<int>(i));
  }
  // Where all others were given up, no more is known than what they were given up at.
  outcome.log_odds = others == kLogZero ? threshold + kGiveUpMargin : top - others;
  if (outcome.log_odds > threshold) outcome.decided = static_cast<int>(best);
  return outcome;
}

}  // namespace shiftmap
