// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace shiftmap {

/// Maps of up to as many modes have the joint covariance of all of them; larger ones that of tiles.
inline constexpr int kMaxJointModes = 300;

/// The joint covariance of all mode positions of a map, stored as symmetric block-sparse 2 x 2
/// blocks.
///
/// Modes are indexed 0..size-1 in map order: groups by signature, within a group by mode number.
/// Blocks that are not stored are zero.
///
/// Threads: const-safe.
class JointCovariance {
 public:
  /// Block (row, column) with row < column: E[(p_row - p̂_row)(p_column - p̂_column)ᵀ]. [m²]
  struct CrossBlock {
    int row = 0;
    int column = 0;
    Eigen::Matrix2d value = Eigen::Matrix2d::Zero();
  };

  JointCovariance() = default;

  /// @param diagonal  The marginal of each mode. [m²]
  /// @param cross     Any order, each pair at most once, row < column < diagonal.size().
  JointCovariance(std::vector<Eigen::Matrix2d> diagonal, std::vector<CrossBlock> cross);

  /// Splits a dense 2n x 2n matrix; drops cross blocks that are exactly zero.
  static JointCovariance FromDense(const Eigen::MatrixXd& dense);

  int size() const { return static_cast<int>(diagonal_.size()); }

  /// Block (row, column) for any order of the two; O(log n).
  Eigen::Matrix2d Block(int row, int column) const;

  /// The stored blocks above the diagonal, by row, then column.
  const std::vector<CrossBlock>& cross_blocks() const { return cross_; }

  /// The dense 2n x 2n matrix, for tests and small maps.
  Eigen::MatrixXd Dense() const;

  /// The same of some modes, 2k x 2k in their order.
  Eigen::MatrixXd Dense(const std::vector<int>& modes) const;

  /// All modes in the smallest sets that no stored block connects, by their first mode, each
  /// ascending: a large map's tiles of neighbours, a survey's single landmarks.
  std::vector<std::vector<int>> Components() const;

  /// The sets of modes that are taken together: all of up to kMaxJointModes, else Components().
  std::vector<std::vector<int>> JointSets() const;

 private:
  std::vector<Eigen::Matrix2d> diagonal_;
  std::vector<CrossBlock> cross_;
  std::vector<std::size_t> row_begin_;  // cross_ of row i is [row_begin_[i], row_begin_[i + 1]).
};

}  // namespace shiftmap
