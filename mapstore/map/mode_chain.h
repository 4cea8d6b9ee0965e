// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapstore/core/stamp.h"

namespace shiftmap {

/// A landmark group's continuous-time Markov chain over its modes.
///
/// States are indexed 0..n with 0 = absent and i = the group's i-th mode in stored order. Rows are
/// *from*, columns are *to*, everywhere: p(t + Δt)ᵀ = p(t)ᵀ Π(Δt) with Π(Δt) = exp(Q Δt), T-IV (5).
/// (T-IV (31) multiplies Π with a column vector, which is right for a symmetric Π only.)
///
/// Threads: const-safe.
class ModeChain {
 public:
  /// The chain that leaves every state at rate λ and then goes to each of the others alike:
  /// Q = λ ((1 1ᵀ - I) / n - I) for n + 1 states.
  /// @param modes             n, the number of regular modes; >= 0.
  /// @param leave_rate_per_s  λ >= 0. [1/s]
  static ModeChain Uniform(int modes, double leave_rate_per_s);

  int states() const { return static_cast<int>(rate_matrix_.rows()); }

  /// λ. [1/s]
  double leave_rate_per_s() const { return leave_rate_per_s_; }

  /// Q, (n+1) x (n+1); rows sum to 0, off-diagonal entries are >= 0. [1/s]
  const Eigen::MatrixXd& rate_matrix() const { return rate_matrix_; }

  /// Π(Δt): row-stochastic, (n+1) x (n+1). A negative Δt counts as zero: a chain is not run
  /// backwards.
  Eigen::MatrixXd Transition(Duration elapsed) const;

  /// p(t + Δt) from p(t), sizes n+1, without forming Π.
  Eigen::VectorXd Propagate(const Eigen::VectorXd& probabilities, Duration elapsed) const;

 private:
  ModeChain(Eigen::MatrixXd rate_matrix, double leave_rate_per_s);

  // Share of the deviation from the stationary distribution that is left after `elapsed`.
  double Remaining(Duration elapsed) const;

  Eigen::MatrixXd rate_matrix_;
  double leave_rate_per_s_ = 0.0;
};

}  // namespace shiftmap
