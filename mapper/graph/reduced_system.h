// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "mapper/graph/cholesky_factor.h"
#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Symmetric positive definite normal equations H x = b, summed up from blocks and solved by
/// Cholesky: dense while small, multifrontal with a fill-reducing order beyond.
class ReducedSystem {
 public:
  /// @param threads  Of a factorization; results do not depend on it.
  ReducedSystem(int size, int threads);

  int size() const { return static_cast<int>(b_.size()); }

  /// b.
  const Eigen::VectorXd& right_side() const { return b_; }

  /// Takes all blocks away. Adding as many over the same unknowns again spares finding an order.
  void Clear();

  /// Adds a block whose rows and columns are those of `index`, each at most once; -1 leaves one
  /// out.
  /// @param H  Its lower triangle counts.
  void Add(const std::vector<int>& index, Eigen::MatrixXd H, const Eigen::VectorXd& b);

  /// The factor of the sum; null if that is not positive definite. It takes the blocks.
  std::shared_ptr<const CholeskyFactor> Factorize();

  /// H⁻¹ b, to a thousandth: by conjugate gradients preconditioned with the last factor if there is
  /// one of the same shape, with a factor of its own where these are slow. Nothing if the system is
  /// not positive definite.
  std::optional<Eigen::VectorXd> Solve();

 private:
  bool dense() const;
  void ForgetShape();
  std::optional<Eigen::VectorXd> ConjugateGradients() const;

  const int threads_;
  Eigen::VectorXd b_;
  Eigen::MatrixXd H_;              // If dense.
  std::vector<SystemTerm> terms_;  // If not; those from added_ on are of before Clear().
  std::size_t added_ = 0;
  std::shared_ptr<const MultifrontalShape> shape_;  // Of terms_; null until it is needed.
  std::shared_ptr<const CholeskyFactor> factor_;    // Of some H of that shape.
};

}  // namespace shiftmap
