// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>

#include "mapper/chain/chain_steps.h"
#include "mapper/chain/gamma.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// Which rates may differ.
enum class ChainStructure {
  kUniform,  ///< One leave rate, all other states alike: ModeChain::Uniform.
  kGeneral,  ///< A rate for each pair of states.
};

/// Where a search begins.
struct RateStart {
  Eigen::VectorXd log_rates;  ///< log x of every parameter. [log 1/s]

  /// Of these, from a fit to much the same; empty if unknown.
  Eigen::MatrixXd covariance;
};

/// Rates that fit a history.
///
/// The parameters are leave rates: x = λ of the uniform structure, x_kl = n q_kl of the general one
/// with n + 1 states. So one Gamma prior serves both, and groups of any size.
struct RateFit {
  ChainStructure structure = ChainStructure::kUniform;
  Eigen::VectorXd log_rates;   ///< log x, by rows of Q in the general structure. [log 1/s]
  Eigen::MatrixXd covariance;  ///< Of the above.
  ModeChain chain = ModeChain::Uniform(0, 0.0);

  double log_likelihood = 0.0;  ///< log p(history | rates). [nat]
  double log_marginal = 0.0;    ///< log p(history | structure, prior), Laplace. [nat]
  double jumps = 0.0;           ///< Expected number in the history.
  double seconds = 0.0;         ///< Between the visits. [s]
  int iterations = 0;
  bool converged = false;

  /// The Gamma distribution with the mean and the precision of parameter i: its shape is 1 / var
  /// (log x_i), which for a chain seen at every time is the exact posterior.
  Gamma Posterior(Eigen::Index i) const;

  /// The same of a rate between two states, from != to. [1/s]
  Gamma PosteriorOfRate(int from, int to) const;

  /// The same of ModeChain::leave_rate_per_s, the mean over the states.
  Gamma PosteriorOfLeaveRate() const;
};

/// Most probable rates given history and prior.
///
/// Of the uniform structure by Newton's method. Of the general one by a quasi-Newton method (BFGS)
/// in log x that begins with the curvature, and the first step, of EM,
///
///     x <- (prior.shape + E[jumps of x]) / (prior.exposure_s + E[time in which x could jump])
///
/// and makes such a step wherever its own would lower the posterior (Jamshidian and Jennrich,
/// Journal of the Royal Statistical Society B 59(3), 1997); the last step is Newton's. The
/// covariance is the inverse of the Hessian of the posterior, of the general structure from
/// differences of its exact gradient; directions in which the history says less than a tenth of the
/// prior's shape count as a tenth of it.
///
/// The answer depends on what was seen, not on how often: every gap counts with the real time.
/// @param steps  Of one phase, at least two states.
/// @param start  None: the prior's mean.
RateFit FitRates(const ChainSteps& steps,
                 ChainStructure structure,
                 const Gamma& prior,
                 const std::optional<RateStart>& start = std::nullopt);

/// Those rates alone, to the root of the relative error: without covariance and marginal likelihood
/// the general structure takes a fraction of the time. Q. [1/s]
Eigen::MatrixXd MostProbableRates(const ChainSteps& steps,
                                  ChainStructure structure,
                                  const Gamma& prior,
                                  const std::optional<RateStart>& start = std::nullopt);

}  // namespace shiftmap
