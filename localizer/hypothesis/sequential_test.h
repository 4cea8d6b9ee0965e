// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

namespace shiftmap {

/// log((1 - α) / α), the threshold of the sequential test for log-ratios; T-IV (17) and (18) print
/// it without the logarithm.
/// @param alpha  Accepted probability of a wrong decision, in (0, 0.5).
double DecisionThreshold(double alpha);

/// Outcome of the multi-hypothesis sequential probability ratio test, T-IV (17, 18).
struct TestOutcome {
  std::optional<int> decided;  ///< The state that beats every other one by the threshold.
  double log_odds = 0.0;       ///< Of the best state to the second best. [nat]
  std::vector<int> hopeless;   ///< States that the best one beats by the threshold.
};

/// @param scores     Unnormalized log-posterior per state; -∞ for states dropped before.
/// @param threshold  Of DecisionThreshold.
TestOutcome TestStates(const Eigen::VectorXd& scores, double threshold);

}  // namespace shiftmap
