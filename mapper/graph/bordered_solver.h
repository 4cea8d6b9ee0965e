// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Solves sparse systems with a border,
///
///   [A  B ] [x]   [b_x]
///   [Bᵀ C ] [c] = [b_c],
///
/// without a factor that has the border in it, which would be on top of every wide front. With c
/// eliminated, which takes nothing but C's blocks, S x = b_x - B C⁻¹ b_c with S = A - B C⁻¹ Bᵀ is
/// solved by conjugate gradients (Hestenes, Stiefel 1952) with A as the preconditioner. The
/// eigenvalues of A⁻¹ S are in (0, 1], and few are far from 1 where x is known well without c.
///
/// One thread; same systems in the same order, same bits.
class BorderedSolver {
 public:
  BorderedSolver(int size, const Border& border) : size_(size), border_(border) {}

  /// The next system has another shape.
  void Forget();

  /// True if there is a factor of A.
  bool has_factor() const { return inner_ && has_factor_; }

  /// Wᵀ A⁻¹ W, as Multifrontal::QuadraticForm(); rows of the border count as zero. Precondition,
  /// here and in SolveUpper(): has_factor().
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& index,
                                const Eigen::MatrixXd& weights) const;

  /// A draw of N(0, A⁻¹) if z is one of N(0, I), as Multifrontal::SolveUpper(); zero in the border.
  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const;

  /// H⁻¹ b. A factor of an earlier, similar A of the same shape is used while that needs few
  /// iterations. Nothing if H is not positive definite or so badly conditioned that too many are
  /// needed.
  /// @param tolerance  Relative error of the solution in the norm of the preconditioner. [-]
  std::optional<Eigen::MatrixXd> Solve(const std::vector<SystemTerm>& terms,
                                       const Eigen::MatrixXd& b,
                                       double tolerance = 1e-4);

  /// Factors A and C's blocks. False if they are not positive definite.
  bool Factorize(const std::vector<SystemTerm>& terms);

  /// Draws of N(0, H⁻¹), a column each: H⁻¹ b with b ~ N(0, H), which is drawn term by term.
  std::optional<Eigen::MatrixXd> Draw(const std::vector<SystemTerm>& terms,
                                      int columns,
                                      std::mt19937_64& random);

  /// (C - Bᵀ A⁻¹ B) E: the information about the border times a matrix of as many rows as the
  /// border has. Precondition, here and below: Factorize() of these terms succeeded.
  Eigen::MatrixXd BorderInformationTimes(const std::vector<SystemTerm>& terms,
                                         const Eigen::MatrixXd& E) const;

  /// -A⁻¹ B c, how the others follow the border; zero in the border.
  Eigen::MatrixXd FollowBorder(const std::vector<SystemTerm>& terms,
                               const Eigen::MatrixXd& c) const;

  /// A⁻¹ b, zero in the border.
  Eigen::MatrixXd SolveHeld(const Eigen::MatrixXd& b) const { return SolveInner(b); }

  /// As Multifrontal::VisitInverse(), of A.
  void VisitInverse(const InverseVisitor& visitor) const;

 private:
  bool FactorizeBorder(const std::vector<SystemTerm>& terms);
  Eigen::MatrixXd SolveBorder(const Eigen::MatrixXd& c) const;
  Eigen::MatrixXd BorderTimes(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& c) const;
  Eigen::MatrixXd Reduce(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd SolveInner(const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd Inner(const Eigen::MatrixXd& x) const;
  Eigen::MatrixXd Outer(const Eigen::MatrixXd& inner) const;
  std::optional<Eigen::MatrixXd> ConjugateGradients(const std::vector<SystemTerm>& terms,
                                                    const Eigen::MatrixXd& b,
                                                    double tolerance,
                                                    int max_iterations) const;

  int size_;
  Border border_;
  std::vector<Eigen::LLT<Eigen::MatrixXd>> blocks_;
  std::unique_ptr<Multifrontal> inner_;  // Of the shape of A; null if that is not known.
  bool has_factor_ = false;              // inner_ is of some A.
};

}  // namespace shiftmap
