// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// What all observations of a group together say of its modes.
struct ModePosteriors {
  Eigen::MatrixXd probabilities;  ///< T x n: Pr(δ_t = k | z_1:T); rows sum to 1.
  double log_evidence = 0.0;      ///< log p(z_1:T), up to the constants of the likelihoods.
};

/// Forward-backward smoothing (Baum et al. 1970) in logarithms, O(T n²):
///
///   log a_t(k) = log p(z_t | k) + log Σ_i exp(log a_{t-1}(i) + log p(k | i)),
///   log b_t(i) = log Σ_k exp(log p(k | i) + log p(z_{t+1} | k) + log b_{t+1}(k)).
///
/// IJRR (23) as printed leaves the other observations out; this does not. The LargestPerStep() of
/// the probabilities have the fewest expected wrong steps; unlike MostLikelyModes the sequence as a
/// whole may be impossible. Precondition: some sequence is possible.
ModePosteriors SmoothModes(const ModeSequenceProblem& problem);

/// The forward half, T x n: Pr(δ_t = k | z_1:t), rows sum to 1. IJRR (23) read recursively: its
/// prior p(δ_t) is (5) run on from the posterior of the observation before, not from p(δ_1) alone.
/// Precondition: some sequence is possible.
Eigen::MatrixXd ForwardPosteriors(const ModeSequenceProblem& problem);

}  // namespace shiftmap
