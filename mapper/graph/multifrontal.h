// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <vector>

#include "mapper/graph/elimination_tree.h"

namespace shiftmap {

/// A term of a sparse symmetric system: a dense block over a few unknowns.
struct SystemTerm {
  std::vector<int> index;  ///< Its unknowns, each once; -1 leaves a row and column out.
  Eigen::MatrixXd H;       ///< The lower triangle counts.
};

/// Σ terms times x, any number of columns.
Eigen::MatrixXd Times(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& x);

/// Called with unknowns, how many of them are new, and their block of an inverse.
using InverseVisitor =
    std::function<void(const std::vector<int>& unknowns, int own, const Eigen::MatrixXd& block)>;

/// Cholesky factor of a sparse sum of dense terms by the multifrontal method (Duff, Reid 1983):
/// unknowns that couple with the same others are eliminated together in dense algebra, and what is
/// left of a front is one more term of its parent's. The order is found once for all sums of the
/// same shape.
///
/// One thread; same input, same bits.
class Multifrontal {
 public:
  /// @param size   Number of unknowns.
  /// @param terms  Their `index` tells the shape; values are not read.
  Multifrontal(int size, const std::vector<SystemTerm>& terms);

  /// Factors Σ terms. False if it is not positive definite.
  /// @param terms  With the indices that the constructor saw.
  bool Factorize(const std::vector<SystemTerm>& terms);

  /// H⁻¹ b, any number of columns.
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const;

  /// P L⁻ᵀ z with P L Lᵀ Pᵀ = H: a draw of N(0, H⁻¹) if z is one of N(0, I).
  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const;

  /// Wᵀ H⁻¹ W = ‖L⁻¹ Pᵀ W‖² of a W that has few rows: only the fronts between those unknowns and
  /// the roots take part.
  /// @param unknowns  Of the rows of `weights`; each once.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& unknowns,
                                const Eigen::MatrixXd& weights) const;

  /// The entries of H⁻¹ where the factor has any, which is in all blocks of all terms, front by
  /// front (Takahashi, Fagan, Chin 1973):
  ///
  ///   Z_SJ = -Z_SS K,   Z_JJ = (L_JJ L_JJᵀ)⁻¹ - Kᵀ Z_SJ,   K = L_SJ L_JJ⁻¹
  ///
  /// with J the front's own unknowns and S the others, of which its parent has told. As costly as
  /// a factorization. The visitor gets every pair of unknowns of a front of which at least one is
  /// among the first `own`, over all fronts each once, and others besides.
  void VisitInverse(const InverseVisitor& visitor) const;

  /// Entries of the factor.
  double fill() const;

 private:
  struct Factor {
    Eigen::MatrixXd L;      // Own columns; lower trapezoid.
    std::vector<int> rows;  // Places of its unknowns in the order of elimination.
    int own = 0;
    int parent = -1;
    std::vector<int> in_parent;  // Of the rows after its own, where they are among the parent's.
    std::vector<int> terms;      // Added here.
  };

  void FindNodes(int size, const std::vector<SystemTerm>& terms);
  void MakeFactors(const std::vector<SystemTerm>& terms);
  bool FactorizeFront(const std::vector<SystemTerm>& terms,
                      std::vector<Eigen::MatrixXd>* left,
                      std::size_t at);
  std::vector<std::size_t> FrontsAbove(const std::vector<int>& unknowns) const;
  void SolveLower(const Factor& factor, Eigen::MatrixXd* x) const;
  Eigen::MatrixXd Permuted(const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd BackSubstitute(Eigen::MatrixXd x) const;

  std::vector<int> node_of_;     // Per unknown.
  std::vector<int> node_begin_;  // Per node its first unknown, and the number of unknowns.
  std::vector<int> place_;       // Per unknown its place in the order of elimination.
  std::vector<int> unknown_;     // Per place.
  std::vector<int> front_;       // Per place the front that eliminates it.
  std::vector<Factor> factors_;
  std::vector<std::vector<int>> children_;
  mutable std::vector<int> local_;  // Scratch: per place its row in the front at hand.
};

}  // namespace shiftmap
