// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/chain/chain_steps.h"

namespace shiftmap {

/// log p(everything seen) of a uniform chain, as a function of u, the logarithm of its leave rate.
struct UniformLikelihood {
  double value = 0.0;      ///< [nat]
  double slope = 0.0;      ///< By u.
  double curvature = 0.0;  ///< By u, twice.
};

/// The value and its exact derivatives, in one pass of the filter that is linear in the states:
///
///     α <- (1 - f) α + f / n,   f = 1 - exp(-λ Δ n / (n - 1))
///
/// and its first two derivatives, then the likelihoods. All states are alike at the first step.
/// @param steps     Of one phase, at least two states. What was seen is possible.
/// @param log_rate  u. [log 1/s]
UniformLikelihood EvaluateUniform(const ChainSteps& steps, double log_rate);

}  // namespace shiftmap
