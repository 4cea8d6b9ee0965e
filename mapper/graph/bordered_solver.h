// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "mapper/graph/chain_elimination.h"
#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Solves sparse systems with a border,
///
///   [A  B ] [x]   [b_x]
///   [Bᵀ C ] [c] = [b_c],
///
/// without a factor that has the border in it, which would be on top of every wide front. Chains
/// and the border are eliminated (ChainElimination), and what is left is solved by conjugate
/// gradients (Hestenes, Stiefel 1952) with a factor of what stands in for it.
///
/// One thread; same systems in the same order, same bits.
class BorderedSolver {
 public:
  BorderedSolver(int size, const Border& border) : size_(size), border_(border) {}

  /// The next system has another shape.
  void Forget();

  /// True if there is a factor of A, or of what stands in for it.
  bool has_factor() const { return has_factor_; }

  /// Wᵀ A⁻¹ W, as Multifrontal::QuadraticForm(); rows of the border count as zero. Precondition,
  /// here and in what draws: has_factor(). W has no rows for poses.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& index,
                                const Eigen::MatrixXd& weights) const;

  /// Unknowns that the factor is over: neither in the border nor of a chain that is cut there.
  int factored_size() const { return static_cast<int>(chains_->others().size()); }

  /// The last `size` unknowns of a draw of N(0, A⁻¹) if z is one of N(0, I), as
  /// Multifrontal::SolveUpper(); zero where chains are cut and in the border.
  /// @param z  factored_size() rows.
  Eigen::MatrixXd DrawTail(int size, const Eigen::MatrixXd& z) const;

  /// H⁻¹ b. The factor of an earlier, similar system of the same shape is used while that needs few
  /// iterations; then one with chains cut wherever some pass; and one with none cut where nothing
  /// else will do.
  /// Nothing if H is not positive definite or so badly conditioned that too many iterations are
  /// needed.
  /// @param tolerance  Relative error of the solution in the norm of the preconditioner. [-]
  std::optional<Eigen::MatrixXd> Solve(const std::vector<SystemTerm>& terms,
                                       const Eigen::MatrixXd& b,
                                       double tolerance = 1e-4);

  /// Factors what stands in for A with chains cut only where many pass. False if it is not positive
  /// definite.
  bool Factorize(const std::vector<SystemTerm>& terms);

  /// Factors what stands in for A in less time: chains are cut wherever some pass.
  bool FactorizeRoughly(const std::vector<SystemTerm>& terms);

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
  Eigen::MatrixXd SolveHeld(const Eigen::MatrixXd& b) const;

  /// As FollowBorder(), with the A that VisitInverse() tells of.
  Eigen::MatrixXd FollowBorderAsVisited(const std::vector<SystemTerm>& terms,
                                        const Eigen::MatrixXd& c) const;

 private:
  // Where chains are cut.
  enum class Cuts { kNone, kWhereManyPass, kWhereSomePass };

  void Adopt(ChainElimination chains);
  bool ShapeFor(Cuts cuts, const std::vector<SystemTerm>& terms);
  bool FactorizeWith(Cuts cuts, const std::vector<SystemTerm>& terms);
  bool FactorizeCut(Cuts cuts, const std::vector<SystemTerm>& terms);
  Eigen::MatrixXd BorderTimes(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& c) const;
  std::optional<Eigen::MatrixXd> ConjugateGradients(bool held,
                                                    const Eigen::MatrixXd& b,
                                                    double tolerance,
                                                    int max_iterations) const;
  std::optional<Eigen::MatrixXd> SolveOthers(bool held,
                                             Eigen::MatrixXd b,
                                             double tolerance,
                                             int max_iterations) const;

  int size_;
  Border border_;
  Cuts cuts_ = Cuts::kNone;
  std::optional<ChainElimination> chains_;
  std::unique_ptr<Multifrontal> factor_;  // Of the shape of chains_' cut terms.
  bool has_factor_ = false;
};

}  // namespace shiftmap
