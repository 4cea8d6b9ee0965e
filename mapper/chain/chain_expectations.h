// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
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
/// it, and c the evidence. The expectations are those of Hobolth and Jensen, Journal of Applied
/// Probability 48(4), 2011. All states are alike at the first step.
///
/// Work is the steps times the squared states, and for each different gap a product of matrices or
/// two: gaps in which the chain hardly jumps by ChainSeries, others by ChainSpectrum, GapIntegral
/// where that loses digits. Of a gap of several phases, Π = Π₁ Π₂, its weights C go to the parts:
/// C Π₂ᵀ to the first and Π₁ᵀ C to the second.
///
/// @param rates  Q of each phase of the steps, rows sum to 0; the steps have a likelihood above 0
///               under them. [1/s]
ChainExpectations ExpectChain(const ChainSteps& steps, const std::vector<Eigen::MatrixXd>& rates);

/// log p(visits from number `first` on | visits before), first >= 1. Prediction one visit ahead,
/// the measure of held-out tests. [nat]
double PredictiveLogLikelihood(const ChainSteps& steps,
                               std::size_t first,
                               const std::vector<Eigen::MatrixXd>& rates);

/// The same of a history.
/// @param chains  One per phase of `period`.
double PredictiveLogLikelihood(const ChainHistory& history,
                               std::size_t first,
                               const std::vector<ModeChain>& chains,
                               Duration period = kRhythmDay);

/// The rate matrices of chains.
std::vector<Eigen::MatrixXd> RatesOf(const std::vector<ModeChain>& chains);

}  // namespace shiftmap
