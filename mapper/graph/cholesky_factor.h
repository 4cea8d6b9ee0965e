// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <functional>
#include <memory>
#include <vector>

namespace shiftmap {

/// Called with unknowns, how many of them are new, and their block of an inverse.
using InverseVisitor =
    std::function<void(const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& block)>;

/// The Cholesky factor of a symmetric positive definite matrix, P L Lᵀ Pᵀ = H. Immutable.
class CholeskyFactor {
 public:
  virtual ~CholeskyFactor() = default;

  /// Rows of H.
  virtual int size() const = 0;

  /// H⁻¹ b, any number of columns.
  virtual Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const = 0;

  /// P L⁻ᵀ z: a sample of N(0, H⁻¹) if z is one of N(0, I).
  virtual Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const = 0;

  /// Wᵀ H⁻¹ W of a W that has few rows other than zero.
  /// @param unknowns  Of the rows of `weights`; each once.
  virtual Eigen::MatrixXd QuadraticForm(const std::vector<int>& unknowns,
                                        const Eigen::MatrixXd& weights) const = 0;

  /// The entries of H⁻¹ for every pair of unknowns of every term of H, each once, and for others.
  /// The pairs are those of which at least one is among the first `own` of a block.
  virtual void VisitInverse(const InverseVisitor& visitor) const = 0;

  /// The block of H⁻¹ of the unknowns [first, first + count).
  Eigen::MatrixXd CovarianceBlock(int first, int count) const;
};

/// The factor of a dense matrix; null if it is not positive definite.
/// @param H  The lower triangle counts.
std::shared_ptr<const CholeskyFactor> MakeDenseFactor(const Eigen::MatrixXd& H);

}  // namespace shiftmap
