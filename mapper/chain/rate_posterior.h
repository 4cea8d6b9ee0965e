// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/chain/chain_steps.h"
#include "mapper/chain/gamma.h"

namespace shiftmap {

/// The posterior of a chain's rates x_kl = n q_kl, over u = log x by rows of Q, at one point.
struct RatePoint {
  Eigen::VectorXd log_rates;  ///< u. [log 1/s]
  double log_likelihood = 0.0;
  double log_posterior = 0.0;
  Eigen::VectorXd jumps;     ///< Expected, per parameter.
  Eigen::VectorXd exposure;  ///< Expected time in which the parameter could jump. [s]
  Eigen::VectorXd gradient;  ///< d log posterior / d u.
};

/// Evaluates it, and climbs it.
class RatePosterior {
 public:
  /// @param steps  Of one phase, at least two states. Outlives this.
  RatePosterior(const ChainSteps& steps, const Gamma& prior) : steps_(steps), prior_(prior) {}

  /// Where the parameter of a pair of states is in u, from != to.
  static Eigen::Index ParameterOf(int states, int from, int to) {
    return static_cast<Eigen::Index>(from) * (states - 1) + (to < from ? to : to - 1);
  }

  /// Q. [1/s]
  Eigen::MatrixXd Rates(const Eigen::VectorXd& log_rates) const;

  RatePoint Evaluate(const Eigen::VectorXd& log_rates) const;

  /// u after a step of EM, which never lowers the posterior.
  Eigen::VectorXd Maximize(const RatePoint& at) const;

  /// The inverse curvature that EM takes the posterior to have.
  Eigen::MatrixXd CompleteCovariance(const RatePoint& at) const;

  /// Climbs until the estimated distance to the top is below `distance`, by quasi-Newton steps and
  /// by those of EM where these fail.
  /// @param covariance  Estimate of the inverse of the posterior's curvature; improved on the way.
  /// @param evaluations  At most this is left to spend; counted down.
  void Climb(double distance, RatePoint* at, Eigen::MatrixXd* covariance, int* evaluations) const;

  /// Minus the Hessian, by differences of the gradient.
  Eigen::MatrixXd Information(const RatePoint& at, int* evaluations) const;

 private:
  const ChainSteps& steps_;
  Gamma prior_;
};

}  // namespace shiftmap
