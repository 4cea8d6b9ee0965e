// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <vector>

#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Symmetric positive definite normal equations H x = b, summed up from blocks and solved by
/// Cholesky: dense while small, multifrontal with a fill-reducing order beyond.
class RestSystem {
 public:
  explicit RestSystem(int size);

  int size() const { return static_cast<int>(b_.size()); }

  /// Takes all blocks away. Adding as many over the same unknowns again spares finding an order.
  void Clear();

  /// Adds a block whose rows and columns are those of `index`, each at most once; -1 leaves one
  /// out.
  /// @param H  Its lower triangle counts.
  void Add(const std::vector<int>& index, Eigen::MatrixXd H, const Eigen::VectorXd& b);

  /// Adds up what is there. False if the system is not positive definite.
  bool Factorize();

  /// H⁻¹ b.
  Eigen::VectorXd Solve() const { return SolveFor(b_); }

  /// H⁻¹ times other right sides.
  Eigen::MatrixXd SolveFor(const Eigen::MatrixXd& b) const;

  /// L⁻ᵀ z: a draw of N(0, H⁻¹) if z is one of N(0, I).
  Eigen::VectorXd Draw(const Eigen::VectorXd& z) const;

  /// The lower right `size` x `size` block of H⁻¹.
  Eigen::MatrixXd TailCovariance(int size) const;

  /// The entries of H⁻¹ for all pairs of unknowns that some block has, and others besides: see
  /// Multifrontal::VisitInverse().
  void VisitInverse(const InverseVisitor& visitor) const;

 private:
  bool dense() const;

  Eigen::VectorXd b_;
  Eigen::MatrixXd H_;                  // If dense.
  Eigen::LLT<Eigen::MatrixXd> dense_;  // If dense.
  std::vector<SystemTerm> terms_;      // If not; those from added_ on are of before Clear().
  std::size_t added_ = 0;
  std::unique_ptr<Multifrontal> factor_;  // If not dense; of the shape of terms_.
};

}  // namespace shiftmap
