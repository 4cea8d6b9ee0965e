// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <Eigen/SparseCore>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Unknowns of a pose in a chain.
inline constexpr int kChainRows = 3;

/// Unknowns [begin, begin + blocks * size) of a system: blocks that do not couple with each other,
/// but each with very many of the other unknowns.
struct Border {
  int begin = 0;
  int blocks = 0;
  int size = 0;  ///< Of a block.

  /// Unknowns before the border are poses in chains, three rows each, and every term has one of
  /// them, two neighbours or none.
  bool chained = false;

  int end() const { return begin + blocks * size; }
  friend bool operator==(const Border&, const Border&) = default;
};

/// Eliminates from a sparse system what is cheap to eliminate exactly: poses along chains, and the
/// border, a block of which goes with each chain. With what is left, the others,
///
///   H = [D  Eᵀ]   D = [T  F]   S = A - E D⁻¹ Eᵀ,
///       [E  A ]       [Fᵀ C]
///
/// T a chain of 3 x 3 blocks, C a block a chain. S is dense, since a chain couples all that it
/// passes, and is not formed, only multiplied by.
///
/// What stands in for S has every chain cut at its poses: each becomes two, one in the term before
/// it and one in the term after, and M, the sum of terms without their poses, the border held, is
/// left. That both were one pose it does not know, and has entries within terms only. However many
/// chains cross a place, a factor of M is no wider than the others there. Chains are cut where many
/// pass: elsewhere little else says how two terms lie to each other, and the pose between them
/// stays among the others.
///
/// With the border held, H without its rows and columns, S - M is positive semidefinite.
///
/// One thread; same input, same bits.
class ChainElimination {
 public:
  /// Rows of what is eliminated and of the others.
  struct Parts {
    Eigen::MatrixXd chains;
    Eigen::MatrixXd others;
  };

  /// Eliminates poses and the border. Nothing if terms have other poses than one or two neighbours.
  /// @param border      With `chained`.
  /// @param terms       Their `index` tells the shape; values are not read. Those of a chain in a
  ///                    row.
  /// @param min_chains  So many chains pass where one is cut: more cuts are cheaper, fewer say
  ///                    more.
  static std::optional<ChainElimination> OfPoses(int size,
                                                 const Border& border,
                                                 const std::vector<SystemTerm>& terms,
                                                 int min_chains);

  /// Eliminates the border alone: M is A.
  static ChainElimination OfBorder(int size,
                                   const Border& border,
                                   const std::vector<SystemTerm>& terms);

  /// Takes the values of a system. False if D is not positive definite.
  /// @param terms  Of the shape it was made for, here and below.
  bool Eliminate(const std::vector<SystemTerm>& terms);

  /// The terms of M without values.
  std::vector<SystemTerm> ShapeOfCutTerms() const;

  /// The terms of M. Nothing if poses of a term are not determined in it.
  std::optional<std::vector<SystemTerm>> CutTerms(const std::vector<SystemTerm>& terms) const;

  /// The unknown of each of the others.
  const std::vector<int>& others() const { return outer_; }

  /// The row of an unknown among the others; -1 if it is eliminated.
  int RowOf(int unknown) const { return inner_[static_cast<std::size_t>(unknown)]; }

  Parts Split(const Eigen::MatrixXd& x) const;
  Eigen::MatrixXd Join(const Parts& parts) const;

  /// Moves the right side of a system to the others: chains D⁻¹ b_c, others b_o - E D⁻¹ b_c.
  /// @param held  The border is held, here and below: T for D, and zero there.
  /// Precondition, here and below: Eliminate() was told of the system and returned true.
  void Reduce(bool held, Parts* b) const;

  /// S x.
  Eigen::MatrixXd Times(bool held, const Eigen::MatrixXd& x) const;

  /// Given the others, what was reduced becomes the solution: chains - D⁻¹ Eᵀ others.
  void Complete(bool held, Parts* x) const;

 private:
  // A term's unknowns that are eliminated, poses first, and the others.
  struct TermParts {
    std::vector<int> chains;      // Places in the term.
    std::vector<int> chain_rows;  // Among all that is eliminated.
    std::ptrdiff_t poses = 0;     // As many are of poses.
    std::vector<int> others;      // Places in the term.
    std::vector<int> other_rows;  // Among the others.
    std::size_t E = 0;            // Where its others x chains begin in E_.
    std::size_t entries = 0;      // Where its lower triangle of others begins in entries_.
  };

  ChainElimination(int size, const Border& border, std::vector<int> poses)
      : size_(size), border_(border), poses_(std::move(poses)) {}

  void MakeParts(const std::vector<SystemTerm>& terms);
  void MakePattern();
  Eigen::Index PoseRows() const { return Eigen::Index{kChainRows} * std::ssize(poses_); }
  bool FactorizePoses(const std::vector<SystemTerm>& terms);
  bool FactorizeBorder(const std::vector<SystemTerm>& terms);
  void SolvePoses(Eigen::MatrixXd* x) const;
  void SolveChains(bool held, Eigen::MatrixXd* x) const;
  Eigen::MatrixXd FromOthers(const Eigen::MatrixXd& x) const;
  Eigen::MatrixXd ToOthers(const Eigen::MatrixXd& x) const;
  template <typename Product>
  void AddProducts(std::vector<int> TermParts::*from,
                   std::vector<int> TermParts::*to,
                   const Product& product,
                   const Eigen::MatrixXd& x,
                   Eigen::MatrixXd* y) const;

  int size_;
  Border border_;
  std::vector<int> poses_;         // Those that are eliminated.
  std::vector<int> eliminated_;    // Unknowns: their rows, then the border.
  std::vector<int> inner_;         // Per unknown its number among the others, or -1.
  std::vector<int> outer_;         // Per one of the others its number.
  std::vector<TermParts> parts_;   // Per term.
  std::size_t largest_ = 0;        // Most unknowns of either kind in a term.
  Eigen::SparseMatrix<double> A_;  // Lower triangle.
  std::vector<int> entries_;       // Of A_, per term those that it adds to, column by column.
  std::vector<double> E_;          // Per term, column by column.
  std::vector<Eigen::LLT<Eigen::Matrix3d>> T_;  // Blocks on the diagonal of its factor,
  std::vector<Eigen::Matrix3d> to_previous_;    // and to the left of it.
  std::vector<int> block_of_;                   // Per pose that is eliminated, of the border.
  Eigen::MatrixXd F_;                           // Columns in the order of a block.
  Eigen::MatrixXd T_inverse_F_;
  std::vector<Eigen::LLT<Eigen::MatrixXd>> border_given_others_;  // C - Fᵀ T⁻¹ F, its blocks.
};

}  // namespace shiftmap
