// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>

#include "mapstore/core/stamp.h"
#include "mapstore/map/chain_rhythm.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A landmark group's continuous-time Markov chain over its modes.
///
/// States are indexed 0..n with 0 = absent and i = the group's i-th mode in stored order. Rows are
/// *from*, columns are *to*, everywhere: p(t + Δt)ᵀ = p(t)ᵀ Π(Δt) with Π(Δt) = exp(Q Δt), T-IV (5).
/// (T-IV (31) multiplies Π with a column vector, which is right for a symmetric Π only.)
///
/// A chain may have a rhythm: rates by the hour of the day or of the week. Its rate matrix is then
/// that of all hours together.
///
/// Threads: const-safe.
class ModeChain {
 public:
  /// The chain that leaves every state at rate λ and then goes to each of the others alike:
  /// Q = λ ((1 1ᵀ - I) / n - I) for n + 1 states.
  /// @param modes             n, the number of regular modes; >= 0.
  /// @param leave_rate_per_s  λ >= 0. [1/s]
  static ModeChain Uniform(int modes, double leave_rate_per_s);

  /// Any chain; one whose rates are all the same is a uniform one.
  /// @param rate_matrix  Q, rows = from; square, off-diagonal entries finite and >= 0. Rows sum to
  /// 0
  ///                     within 1e-9 of the rate of leaving; the diagonal is made exact. [1/s]
  /// Errors: kInvalidArgument, naming the entry or row.
  static StatusOr<ModeChain> FromRates(const Eigen::MatrixXd& rate_matrix);

  /// The same chain with a rhythm. Errors: kInvalidArgument if that has another number of states.
  StatusOr<ModeChain> WithRhythm(ChainRhythm rhythm) const;

  /// Null if the rates are the same at all hours. Lifetime: the chain's.
  const ChainRhythm* rhythm() const { return rhythm_.get(); }

  /// True if the rate matrix is that of Uniform(states() - 1, leave_rate_per_s()).
  bool uniform() const { return uniform_; }

  int states() const { return static_cast<int>(rate_matrix_.rows()); }

  /// λ; if the chain is not uniform, the mean over the states of the rate of leaving. [1/s]
  double leave_rate_per_s() const { return leave_rate_per_s_; }

  /// Q, (n+1) x (n+1); rows sum to 0, off-diagonal entries are >= 0. [1/s]
  const Eigen::MatrixXd& rate_matrix() const { return rate_matrix_; }

  /// Where the uniform distribution relaxes to: itself if the chain is uniform. Size n+1; sums
  /// to 1.
  const Eigen::VectorXd& stationary() const { return stationary_; }

  /// Π(Δt) of the rate matrix, as if there were no rhythm: row-stochastic, (n+1) x (n+1), at any Δt
  /// from nanoseconds to centuries. A negative Δt counts as zero: a chain is not run backwards.
  /// Closed form if uniform or of two states, else by scaling and squaring.
  Eigen::MatrixXd Transition(Duration elapsed) const;

  /// Π from one time to another, with the rhythm. The identity if `to` is not later.
  Eigen::MatrixXd Transition(Stamp from, Stamp to) const;

  /// Share of a distribution that a uniform chain has spread evenly after Δt, in [0, 1).
  double Forgotten(Duration elapsed) const;

  /// Spreads that share of a distribution, in place.
  static void Spread(double forgotten, Eigen::VectorXd* probabilities);

  /// p(to) from p(from), sizes n+1, with the rhythm; without forming Π if the chain is uniform. If
  /// `to` is not later, nothing changes: a chain is not run backwards.
  Eigen::VectorXd Propagate(const Eigen::VectorXd& probabilities, Stamp from, Stamp to) const;

  /// The same after Δt, as if there were no rhythm.
  Eigen::VectorXd Propagate(const Eigen::VectorXd& probabilities, Duration elapsed) const;

 private:
  ModeChain(Eigen::MatrixXd rate_matrix, double leave_rate_per_s);

  Eigen::MatrixXd rate_matrix_;
  Eigen::VectorXd stationary_;
  double leave_rate_per_s_ = 0.0;
  bool uniform_ = true;
  std::shared_ptr<const ChainRhythm> rhythm_;
};

}  // namespace shiftmap
