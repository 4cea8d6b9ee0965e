// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "localizer/hypothesis/state_values.h"

namespace shiftmap {

/// log((1 - α) / α), the threshold of the sequential test for log-ratios; T-IV (17) and (18) print
/// it without the logarithm.
/// @param alpha  Accepted probability of a wrong decision, in (0, 0.5).
double DecisionThreshold(double alpha);

using RejectedStates = boost::container::small_vector<int, kInlineStates>;

/// Outcome of the multi-hypothesis sequential probability ratio test.
///
/// T-IV (17) asks the best state to beat each other one by the threshold. With n alternatives that
/// are equally likely the decision is then wrong with nearly n α. Here it has to beat all of them
/// together: its posterior is above 1 - α.
struct TestOutcome {
  std::optional<int> decided;  ///< The state that beats the sum of all others by the threshold.
  double log_odds = 0.0;       ///< Of the best state to all others, finite. [nat]
  RejectedStates rejected;     ///< States below a hundredth of α of the best one.
};

/// @param scores     Unnormalized log-posterior per state; -∞ for states dropped before.
/// @param threshold  Of DecisionThreshold.
TestOutcome TestStates(const Eigen::Ref<const Eigen::VectorXd>& scores, double threshold);

}  // namespace shiftmap
