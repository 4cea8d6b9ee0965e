// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <memory>
#include <utility>
#include <vector>

#include "mapper/graph/multifrontal.h"

namespace shiftmap {

/// Stands in for a sparse system A over chains of poses and what they have in common, the border
/// held, without a factor in which chains are. With the poses o eliminated A is
///
///   [I          ] [T   ] [I  T⁻¹ Bᵀ]
///   [B T⁻¹   I  ] [   S] [   I     ],   S = A_ii - B T⁻¹ Bᵀ,
///
/// T a chain of 3 x 3 blocks, and S dense: a chain couples all that it passes. Here every chain is
/// cut at its poses instead, each of which becomes two, one in the term before it and one in the
/// term after, and M, the sum of terms without their poses, takes the place of S. It says a little
/// less, that both were one pose, and has entries within terms only. However many chains cross a
/// place, the factor of M is no wider than the modes there. Where little else says how two terms
/// lie to each other, the pose between them stays.
///
/// One thread; same input, same bits.
class ChainPreconditioner {
 public:
  /// @param border  With `chained`.
  /// @param stays   Poses that are not cut, by number; none if empty.
  ChainPreconditioner(int size, const Border& border, std::vector<bool> stays = {})
      : size_(size), border_(border), stays_(std::move(stays)) {}

  /// False if it was told of poses that stay.
  bool CutsAll() const { return stays_.empty(); }

  /// The next system has another shape.
  void Forget();

  bool has_factor() const { return has_factor_; }

  /// False if it is not positive definite, or terms have other poses than one or two neighbours.
  /// @param terms  Of the shape that the last ones had, unless Forget() was called.
  bool Factorize(const std::vector<SystemTerm>& terms);

  /// The solution for any number of columns, zero in the border. Precondition, here and below:
  /// has_factor().
  Eigen::MatrixXd Solve(const Eigen::MatrixXd& b) const;

  /// A draw of N(0, M⁻¹) if z is one of N(0, I); zero in the border and for poses that are cut.
  Eigen::MatrixXd SolveUpper(const Eigen::MatrixXd& z) const;

  /// As Multifrontal::VisitInverse(), of M, whose inverse is that of the whole but for the poses
  /// that are cut.
  void VisitInverse(const InverseVisitor& visitor) const;

  /// Wᵀ M⁻¹ W of a W that has few rows, none for poses; rows of the border count as zero.
  Eigen::MatrixXd QuadraticForm(const std::vector<int>& index,
                                const Eigen::MatrixXd& weights) const;

 private:
  // A term's unknowns: rows of poses that are cut, and of M.
  struct Split {
    std::vector<int> poses;      // Places in the term.
    std::vector<int> pose_rows;  // Among all that are cut.
    std::vector<int> others;     // Places in the term; their rows are in terms_.
    Eigen::MatrixXd B;           // Others, poses.
  };

  // What a term has of a chain: at most two poses, the modes that it passes, ascending, and the
  // block of the border that is the chain's.
  struct Stretch {
    std::vector<int> poses;
    std::vector<int> modes;  // Their first unknowns.
    int chain = -1;
  };

  Stretch StretchOf(const SystemTerm& term) const;
  bool FindCuts(const std::vector<SystemTerm>& terms);
  bool Shape(const std::vector<SystemTerm>& terms);
  bool Cut(const SystemTerm& term, std::size_t at);
  bool FactorizeChains(const std::vector<SystemTerm>& terms);
  void SolveChains(Eigen::MatrixXd* x) const;
  Eigen::MatrixXd Inner(const Eigen::MatrixXd& x) const;
  Eigen::MatrixXd Outer(const Eigen::MatrixXd& inner) const;

  int size_;
  Border border_;
  std::vector<bool> stays_;
  bool has_shape_ = false;
  bool has_factor_ = false;
  std::vector<int> inner_;         // Per unknown its number in M, or -1.
  std::vector<int> outer_;         // Per unknown of M its number.
  std::vector<int> cut_;           // Per pose its number among those that are cut, or -1.
  std::vector<int> poses_;         // Those that are cut.
  std::vector<Split> splits_;      // Per term.
  std::vector<SystemTerm> terms_;  // Of M.
  std::vector<Eigen::LLT<Eigen::Matrix3d>> chain_;  // Of T: blocks on the diagonal of its factor,
  std::vector<Eigen::Matrix3d> to_previous_;        // and to the left of it.
  std::unique_ptr<Multifrontal> factor_;            // Of M.
};

}  // namespace shiftmap
