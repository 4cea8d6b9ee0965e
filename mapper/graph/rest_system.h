// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <optional>
#include <random>
#include <vector>

#include "mapper/graph/bordered_solver.h"
#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Symmetric positive definite normal equations H x = b, summed up from blocks and solved by
/// Cholesky: dense while small, multifrontal with a fill-reducing order beyond.
class RestSystem {
 public:
  /// @param border  Unknowns that SolveSimilar() is to leave out of a factor if they are many.
  explicit RestSystem(int size, const Border& border = {});

  const Border& border() const { return border_; }
  int size() const { return static_cast<int>(b_.size()); }

  /// b.
  const Eigen::VectorXd& right_side() const { return b_; }

  /// Takes all blocks away. Adding as many over the same unknowns again spares finding an order.
  void Clear();

  /// Adds a block whose rows and columns are those of `index`, each at most once; -1 leaves one
  /// out.
  /// @param H  Its lower triangle counts.
  void Add(const std::vector<int>& index, Eigen::MatrixXd H, const Eigen::VectorXd& b);

  /// Adds up what is there. False if the system is not positive definite. With a border of very
  /// many blocks the factor is without it (HoldsBorder).
  bool Factorize();

  /// As Factorize() for solves; with a border of very many blocks a factor of an earlier, similar H
  /// will do, or one that takes less.
  bool FactorizeSimilar();

  /// H⁻¹ b without Factorize(), to a millionth, with a border of very many blocks to a hundredth:
  /// by conjugate gradients on the factor of an earlier, similar H if there is one of the same
  /// shape, with a factor of its own where these are slow. Nothing if the system is not positive
  /// definite. Precondition: no Factorize() since the blocks were added, it may take them.
  std::optional<Eigen::VectorXd> SolveSimilar();

  /// True if there is no factor but one, of an earlier, similar H, without the border: DrawTail()
  /// and QuadraticForm() are then those of the system with the border held at zero.
  bool HoldsBorder() const;

  /// H⁻¹ b. Precondition, here and in what follows: Factorize() succeeded.
  Eigen::VectorXd Solve() const { return SolveFor(b_); }

  /// H⁻¹ times other right sides.
  Eigen::MatrixXd SolveFor(const Eigen::MatrixXd& b) const;

  /// Wᵀ H⁻¹ W of a W that has few rows.
  /// @param index  Of the rows of `weights`; each once.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& index,
                                const Eigen::MatrixXd& weights) const;

  /// Unknowns that the factor is over: all, fewer while HoldsBorder().
  int factored_size() const { return HoldsBorder() ? bordered_.factored_size() : size(); }

  /// The last `size` rows of L⁻ᵀ z, any number of columns: of a draw of N(0, H⁻¹) if z is one of
  /// N(0, I).
  /// @param z  factored_size() rows.
  Eigen::MatrixXd DrawTail(int size, const Eigen::MatrixXd& z) const;

  /// SolveFor(), as exact as draws need it.
  Eigen::MatrixXd SolveForDraws(const Eigen::MatrixXd& b) const;

  /// Draws of N(0, H⁻¹), a column each, the border included. Precondition: HoldsBorder().
  Eigen::MatrixXd DrawColumns(int columns, std::mt19937_64& random);

  /// -A⁻¹ B c, how the others follow the border. Precondition: HoldsBorder(), with a factor of its
  /// own.
  Eigen::MatrixXd FollowBorder(const Eigen::MatrixXd& c) const {
    return bordered_.FollowBorder(terms_, c);
  }

  /// The same with the A that VisitInverse() and SolveHeld() are of.
  Eigen::MatrixXd FollowBorderAsVisited(const Eigen::MatrixXd& c) const {
    return bordered_.FollowBorderAsVisited(terms_, c);
  }

  /// A⁻¹ b, with the border held at zero. Precondition: as FollowBorder().
  Eigen::MatrixXd SolveHeld(const Eigen::MatrixXd& b) const { return bordered_.SolveHeld(b); }

  /// The information about the border, all others unknown, times a matrix: the inverse of that part
  /// of H⁻¹, which need not be known.
  Eigen::MatrixXd BorderInformationTimes(const Eigen::MatrixXd& E) const;

  /// The lower right `size` x `size` block of H⁻¹.
  Eigen::MatrixXd TailCovariance(int size) const;

  /// The entries of H⁻¹ for all pairs of unknowns that some block has, and others besides: see
  /// Multifrontal::VisitInverse().
  void VisitInverse(const InverseVisitor& visitor) const;

 private:
  bool dense() const;
  Eigen::MatrixXd SolveTo(double bordered_tolerance, const Eigen::MatrixXd& b) const;
  void Forget();
  void Shape();
  std::optional<Eigen::VectorXd> ConjugateGradients() const;

  Eigen::VectorXd b_;
  Border border_;
  mutable BorderedSolver bordered_;    // If not dense.
  Eigen::MatrixXd H_;                  // If dense.
  Eigen::LLT<Eigen::MatrixXd> dense_;  // If dense.
  std::vector<SystemTerm> terms_;      // If not; those from added_ on are of before Clear().
  std::size_t added_ = 0;
  std::unique_ptr<Multifrontal> factor_;  // If not dense; of the shape of terms_.
  bool has_factor_ = false;               // factor_ is of some H.
};

}  // namespace shiftmap
