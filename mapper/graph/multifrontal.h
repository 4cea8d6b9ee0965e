// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <memory>
#include <vector>

#include "mapper/graph/cholesky_factor.h"
#include "mapper/graph/elimination_tree.h"

namespace shiftmap {

/// A term of a sparse symmetric system: a dense block over a few unknowns.
struct SystemTerm {
  std::vector<int> index;  ///< Its unknowns, each once; -1 leaves a row and column out.
  Eigen::MatrixXd H;       ///< The lower triangle counts.
};

/// Σ terms times x, any number of columns.
Eigen::MatrixXd Times(const std::vector<SystemTerm>& terms, const Eigen::MatrixXd& x);

/// The symbolic factor of all sums of terms over the same unknowns: the order of elimination, and
/// the fronts in which unknowns that couple with the same others are eliminated together.
class MultifrontalShape {
 public:
  struct FrontShape {
    std::vector<int> rows;  ///< Positions of its unknowns in the order of elimination, ascending.
    int own = 0;            ///< The first of them, which are eliminated here.
    int parent = -1;
    std::vector<int> children;
    std::vector<int> row_in_parent;  ///< Of the rows after its own.
    std::vector<int> terms;          ///< Added here.
  };

  /// @param size   Number of unknowns.
  /// @param terms  Their `index` tells the shape; values are not read.
  MultifrontalShape(int size, const std::vector<SystemTerm>& terms);

  const std::vector<FrontShape>& fronts() const { return fronts_; }  ///< Children before parents.
  const std::vector<int>& unknowns() const { return unknowns_; }     ///< By position.

  /// Multiplications of a factorization, and of a solve with one right side.
  double factor_products() const { return factor_products_; }
  double solve_products() const { return solve_products_; }

  int PositionOf(int unknown) const { return position_[static_cast<std::size_t>(unknown)]; }

  /// Fronts of subtrees of the elimination tree, which can be factored side by side, and those
  /// above them; ascending.
  const std::vector<std::vector<std::size_t>>& subtrees() const { return subtrees_; }
  const std::vector<std::size_t>& above_subtrees() const { return above_subtrees_; }

  /// The fronts of some unknowns and all above them, ascending.
  std::vector<std::size_t> FrontsAbove(const std::vector<int>& unknowns) const;

 private:
  class Nodes;

  void OrderUnknowns(const Nodes& nodes, const EliminationTree& tree);
  void MakeFronts(const Nodes& nodes, const EliminationTree& tree);
  void LinkToParents();
  void AssignTerms(const std::vector<SystemTerm>& terms);
  void CountProducts();
  void Divide(const std::vector<double>& products);

  std::vector<int> position_;           // Per unknown in the order of elimination.
  std::vector<int> unknowns_;           // Per position.
  std::vector<int> front_of_position_;  // The front that eliminates it.
  std::vector<FrontShape> fronts_;
  std::vector<std::vector<std::size_t>> subtrees_;
  std::vector<std::size_t> above_subtrees_;
  double factor_products_ = 0.0;
  double solve_products_ = 0.0;
};

/// Cholesky factor of a sparse sum of dense terms by the multifrontal method (Duff, Reid 1983). The
/// update matrix of a front, what its elimination leaves over its other unknowns, is one more term
/// of its parent's front.
///
/// Same input, same bits, on any number of threads.
class MultifrontalFactor final : public CholeskyFactor {
 public:
  /// Factors Σ terms; null if it is not positive definite.
  /// @param terms  Of the shape.
  static std::shared_ptr<const MultifrontalFactor> Of(
      std::shared_ptr<const MultifrontalShape> shape,
      const std::vector<SystemTerm>& terms,
      int threads);

  int size() const override { return static_cast<int>(shape_->unknowns().size()); }
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const override;
  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const override;

  /// ‖L⁻¹ Pᵀ W‖²: only the fronts between those unknowns and the roots take part.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& unknowns,
                                const Eigen::MatrixXd& weights) const override;

  /// The selected inverse (Takahashi, Fagan, Chin 1973), front by front:
  ///
  ///   Z_SJ = -Z_SS K,   Z_JJ = (L_JJ L_JJᵀ)⁻¹ - Kᵀ Z_SJ,   K = L_SJ L_JJ⁻¹
  ///
  /// with J the front's own unknowns and S the others, of which its parent has told. As costly as a
  /// factorization.
  void VisitInverse(const InverseVisitor& visitor) const override;

 private:
  class Factorization;

  explicit MultifrontalFactor(std::shared_ptr<const MultifrontalShape> shape)
      : shape_(std::move(shape)) {}

  void SolveLower(std::size_t front, Eigen::MatrixXd* x) const;
  Eigen::MatrixXd Permuted(const Eigen::MatrixXd& b) const;
  Eigen::MatrixXd BackSubstitute(Eigen::MatrixXd x) const;

  std::shared_ptr<const MultifrontalShape> shape_;
  std::vector<Eigen::MatrixXd> L_;  // Per front its own columns; lower trapezoid.
};

}  // namespace shiftmap
