// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "mapper/graph/chain_preconditioner.h"
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
  BorderedSolver(int size, const Border& border)
      : size_(size), border_(border), chain_(size, border) {}

  /// The next system has another shape.
  void Forget();

  /// True if there is a factor of A, or of what stands in for it (ChainPreconditioner).
  bool has_factor() const { return has_factor_ || chain_.has_factor(); }

  /// Wᵀ A⁻¹ W, as Multifrontal::QuadraticForm(); rows of the border count as zero. Precondition,
  /// here and in SolveUpper(): has_factor(). If it is not of A, W has no rows for poses.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& index,
                                const Eigen::MatrixXd& weights) const;

  /// A draw of N(0, A⁻¹) if z is one of N(0, I), as Multifrontal::SolveUpper(); zero in the border,
  /// and for poses if the factor is not of A.
  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const;

  /// H⁻¹ b. What there is of an earlier, similar A of the same shape is used while that needs few
  /// iterations; then what stands in for A where there are chains; and a factor of A where nothing
  /// else will do. Nothing if H is not positive definite or so badly conditioned that too many
  /// iterations are needed.
  /// @param tolerance  Relative error of the solution in the norm of the preconditioner. [-]
  std::optional<Eigen::MatrixXd> Solve(const std::vector<SystemTerm>& terms,
                                       const Eigen::MatrixXd& b,
                                       double tolerance = 1e-4);

  /// Factors C's blocks and, where there are chains, what stands in for A, else A. False if they
  /// are not positive definite.
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

  /// As Multifrontal::VisitInverse(), of A or of what stands in for it, which says a little less:
  /// its inverse is no smaller.
  void VisitInverse(const InverseVisitor& visitor) const;

  /// A⁻¹ b, zero in the border, with the A that VisitInverse() tells of.
  Eigen::MatrixXd SolveHeld(const Eigen::MatrixXd& b) const { return Precondition(b); }

  /// As FollowBorder(), with the A that VisitInverse() tells of.
  Eigen::MatrixXd FollowBorderAsVisited(const std::vector<SystemTerm>& terms,
                                        const Eigen::MatrixXd& c) const;

 private:
  bool FactorizeInner(const std::vector<SystemTerm>& terms);
  bool FactorizeBorder(const std::vector<SystemTerm>& terms);
  Eigen::MatrixXd SolveBorder(const Eigen::MatrixXd& c) const;
  Eigen::MatrixXd BorderTimes(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& c) const;
  Eigen::MatrixXd Reduce(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd SolveInner(const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd Precondition(const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd Inner(const Eigen::MatrixXd& x) const;
  Eigen::MatrixXd Outer(const Eigen::MatrixXd& inner) const;
  void HoldBorder(Eigen::MatrixXd* x) const;
  template <typename Product>
  std::optional<Eigen::MatrixXd> ConjugateGradients(const Product& times,
                                                    Eigen::MatrixXd residual,
                                                    double tolerance,
                                                    int max_iterations) const;
  std::optional<Eigen::MatrixXd> ConjugateGradients(const std::vector<SystemTerm>& terms,
                                                    const Eigen::MatrixXd& b,
                                                    double tolerance,
                                                    int max_iterations) const;

  int size_;
  Border border_;
  ChainPreconditioner chain_;
  std::vector<Eigen::LLT<Eigen::MatrixXd>> blocks_;
  std::unique_ptr<Multifrontal> inner_;  // Of the shape of A; null if that is not known.
  bool has_factor_ = false;              // inner_ is of some A.
};

}  // namespace shiftmap
