// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/chain/chain_steps.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// What a chain is expected to have done, given all that was seen.
struct ChainExpectations {
  double log_likelihood = 0.0;  ///< log p(everything seen). [nat]

  /// Per phase G, states x states. G(k, k) is the time spent in k [s], and q_kl G(k, l) the number
  /// of jumps from k to l, both expected.
  std::vector<Eigen::MatrixXd> integrals;
};

/// Forward-backward over the steps, and between two of them, Δ apart,
///
///     G = ∫_0^Δ exp(Qᵀ s) C exp(Qᵀ (Δ - s)) ds,   C = α (l ∘ β)ᵀ / c
///
/// with α the filtered distribution before the gap, l and β likelihood and backward message after
/// it, and c the evidence. The integral has a closed form for a uniform chain; else it is taken in
/// the eigenvectors of Q (ChainSpectrum); where these lose digits, it is a block of an exponential
/// of twice the size (Van Loan, IEEE Transactions on Automatic Control 23(3), 1978). The
/// expectations are those of Hobolth and Jensen, Journal of Applied Probability 48(4), 2011. All
/// states are alike at the first step.
///
/// @param chains  One per phase of the steps; what was seen is possible under them.
ChainExpectations ExpectChain(const ChainSteps& steps, const std::vector<ModeChain>& chains);

/// The log-likelihood alone; -infinity if what was seen is impossible.
double ChainLogLikelihood(const ChainSteps& steps, const std::vector<ModeChain>& chains);

/// log p(visits from number `first` on | visits before). Prediction one visit ahead, the measure of
/// held-out tests. [nat]
/// @param chains          One per phase of `period`.
/// @param gap_resolution  Of MakeChainSteps.
double PredictiveLogLikelihood(const ChainHistory& history,
                               std::size_t first,
                               const std::vector<ModeChain>& chains,
                               Duration period = kRhythmDay,
                               double gap_resolution = 0.0);

/// The integral G of one gap, for any C >= 0. [s, if C has no unit]
Eigen::MatrixXd GapIntegral(const ModeChain& chain, Duration gap, const Eigen::MatrixXd& weights);

}  // namespace shiftmap
