// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/SparseCholesky>
#include <Eigen/SparseCore>
#include <vector>

namespace shiftmap {

/// Symmetric positive definite normal equations H x = b, summed up from blocks and solved by
/// Cholesky: dense while small, sparse with a fill-reducing order beyond.
class RestSystem {
 public:
  explicit RestSystem(int size);

  int size() const { return static_cast<int>(b_.size()); }

  /// Adds a block whose rows and columns are those of `index`; -1 leaves one out.
  /// @param H  Its lower triangle counts.
  void Add(const std::vector<int>& index, const Eigen::MatrixXd& H, const Eigen::VectorXd& b);

  /// Adds up what is there. False if the system is not positive definite.
  bool Factorize();

  /// H⁻¹ b.
  Eigen::VectorXd Solve() const { return SolveFor(b_); }

  /// L⁻ᵀ z: a draw of N(0, H⁻¹) if z is one of N(0, I).
  Eigen::VectorXd Draw(const Eigen::VectorXd& z) const;

  /// The lower right `size` x `size` block of H⁻¹.
  Eigen::MatrixXd TailCovariance(int size) const;

 private:
  using Sparse = Eigen::SparseMatrix<double>;

  bool dense() const;
  Eigen::MatrixXd SolveFor(const Eigen::MatrixXd& b) const;

  Eigen::VectorXd b_;
  Eigen::MatrixXd H_;                                  // If dense.
  Eigen::LLT<Eigen::MatrixXd> dense_;                  // If dense.
  std::vector<Eigen::Triplet<double>> entries_;        // If sparse.
  Eigen::SimplicialLLT<Sparse, Eigen::Lower> sparse_;  // If sparse.
};

}  // namespace shiftmap
