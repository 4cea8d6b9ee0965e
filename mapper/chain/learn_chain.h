// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapper/chain/gamma.h"
#include "mapper/chain/rate_fit.h"
#include "proto/core/status.h"

namespace shiftmap {

struct ChainLearningOptions {
  /// Prior of the leave rates, by default one jump a day or so. A Gamma distribution hardly allows
  /// rates far above its mean; what makes up for that is share_prior.
  Gamma prior{0.5, 0.5e5};

  /// Estimate the prior from the groups' own rates, be it one group. Without, it is taken as given.
  bool share_prior = true;

  /// How many groups' worth the prior above counts when the shared one is estimated; > 0.
  double prior_groups = 1.0;

  /// Given, or else both, each with the weight of its marginal likelihood. The general structure is
  /// fitted up to four states, and up to ten if the uniform one expects as many jumps as there are
  /// pairs of states. The cost of that fit grows with about the fifth power of the states.
  std::optional<ChainStructure> structure;

  double interval = 0.95;  ///< Probability of the intervals; in (0, 1).

  /// Of MakeChainSteps; >= 0.
  double gap_resolution = 0.0;

  /// On which groups are fitted; the result does not depend on them.
  int threads = 1;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// A rate and where it lies with the probability ChainLearningOptions::interval. [1/s]
struct RateInterval {
  double rate_per_s = 0.0;
  double low_per_s = 0.0;
  double high_per_s = 0.0;
};

/// A chain that was learned.
struct LearnedChain {
  Signature signature;

  /// The mean over the structures, each rate by the structures' probabilities. Few visits do not
  /// tell the structure, and one chosen by them would change with the next.
  ModeChain chain = ModeChain::Uniform(0, 0.0);

  RateFit fit;           ///< Of the more probable structure.
  RateInterval leave;    ///< Of ModeChain::leave_rate_per_s.
  Eigen::MatrixXd low;   ///< Per pair of states, diagonal 0. [1/s]
  Eigen::MatrixXd high;  ///< Likewise.

  /// Probability of the general structure, both taken for equally likely before the visits.
  double general = 0.0;

  std::int64_t visits = 0;
};

struct LearnedChains {
  std::vector<LearnedChain> chains;  ///< In the order of the histories.
  Gamma prior;                       ///< Of the leave rates, shared by the groups.
};

/// The rates of several groups' chains from their histories, with one prior whose hyper-parameters
/// are estimated from all of them (empirical Bayes): a group that was hardly seen gets the rates
/// that are usual here, and an interval that says so.
///
/// The prior is found by EM over the groups, to which each contributes the mean of E x and E log x
/// over its parameters; ChainLearningOptions::prior counts like prior_groups groups. Of more than
/// 200 groups, 100 to 200 evenly spread ones tell it. A group without modes has nothing to learn
/// and gets rate 0. Determinism: independent of anything but the input and its order. Errors:
/// kInvalidArgument, as CheckHistory and Validate.
StatusOr<LearnedChains> LearnChains(const std::vector<ChainHistory>& histories,
                                    const ChainLearningOptions& options);

/// One group by itself: its rates share a prior with each other only.
StatusOr<LearnedChain> LearnChain(const ChainHistory& history, const ChainLearningOptions& options);

}  // namespace shiftmap
