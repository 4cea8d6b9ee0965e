// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/joint_covariance.h"

#include <algorithm>
#include <numeric>
#include <tuple>
#include <utility>

#include "proto/core/check.h"

namespace shiftmap {

JointCovariance::JointCovariance(std::vector<Eigen::Matrix2d> diagonal,
                                 std::vector<CrossBlock> cross)
    : diagonal_(std::move(diagonal)), cross_(std::move(cross)) {
  std::sort(cross_.begin(), cross_.end(), [](const CrossBlock& a, const CrossBlock& b) {
    return std::tie(a.row, a.column) < std::tie(b.row, b.column);
  });
  for (std::size_t i = 1; i < cross_.size(); ++i) {
    SHIFTMAP_CHECK(cross_[i - 1].row != cross_[i].row || cross_[i - 1].column != cross_[i].column,
                   "block ({}, {}) twice",
                   cross_[i].row,
                   cross_[i].column);
  }
  row_begin_.assign(diagonal_.size() + 1, 0);
  for (const CrossBlock& block : cross_) {
    SHIFTMAP_CHECK(0 <= block.row && block.row < block.column && block.column < size(),
                   "block ({}, {}) of {} modes",
                   block.row,
                   block.column,
                   size());
    ++row_begin_[static_cast<std::size_t>(block.row) + 1];
  }
  for (std::size_t i = 1; i < row_begin_.size(); ++i) row_begin_[i] += row_begin_[i - 1];
}

JointCovariance JointCovariance::FromDense(const Eigen::MatrixXd& dense) {
  SHIFTMAP_CHECK(
      dense.rows() == dense.cols() && dense.rows() % 2 == 0, "{} x {}", dense.rows(), dense.cols());
  const int modes = static_cast<int>(dense.rows() / 2);
  std::vector<Eigen::Matrix2d> diagonal;
  std::vector<CrossBlock> cross;
  for (int row = 0; row < modes; ++row) {
    diagonal.push_back(dense.block<2, 2>(Eigen::Index{2} * row, Eigen::Index{2} * row));
    for (int column = row + 1; column < modes; ++column) {
      const Eigen::Matrix2d value =
          dense.block<2, 2>(Eigen::Index{2} * row, Eigen::Index{2} * column);
      if (!value.isZero(0.0)) cross.push_back({row, column, value});
    }
  }
  return JointCovariance(std::move(diagonal), std::move(cross));
}

Eigen::Matrix2d JointCovariance::Block(int row, int column) const {
  SHIFTMAP_CHECK(0 <= row && row < size() && 0 <= column && column < size(),
                 "block ({}, {}) of {} modes",
                 row,
                 column,
                 size());
  if (row == column) return diagonal_[static_cast<std::size_t>(row)];
  const auto [low, high] = std::minmax(row, column);
  const auto begin =
      cross_.begin() + static_cast<std::ptrdiff_t>(row_begin_[static_cast<std::size_t>(low)]);
  const auto end =
      cross_.begin() + static_cast<std::ptrdiff_t>(row_begin_[static_cast<std::size_t>(low) + 1]);
  const auto found = std::lower_bound(
      begin, end, high, [](const CrossBlock& block, int wanted) { return block.column < wanted; });
  if (found == end || found->column != high) return Eigen::Matrix2d::Zero();
  if (row < column) return found->value;
  return found->value.transpose();
}

Eigen::MatrixXd JointCovariance::Dense() const {
  Eigen::MatrixXd dense = Eigen::MatrixXd::Zero(Eigen::Index{2} * size(), Eigen::Index{2} * size());
  for (int i = 0; i < size(); ++i)
    dense.block<2, 2>(Eigen::Index{2} * i, Eigen::Index{2} * i) =
        diagonal_[static_cast<std::size_t>(i)];
  for (const CrossBlock& block : cross_) {
    dense.block<2, 2>(Eigen::Index{2} * block.row, Eigen::Index{2} * block.column) = block.value;
    dense.block<2, 2>(Eigen::Index{2} * block.column, Eigen::Index{2} * block.row) =
        block.value.transpose();
  }
  return dense;
}

Eigen::MatrixXd JointCovariance::Dense(const std::vector<int>& modes) const {
  const std::ptrdiff_t size = 2 * std::ssize(modes);
  Eigen::MatrixXd dense(size, size);
  for (std::size_t a = 0; a < modes.size(); ++a) {
    for (std::size_t b = 0; b < modes.size(); ++b) {
      dense.block<2, 2>(static_cast<Eigen::Index>(2 * a), static_cast<Eigen::Index>(2 * b)) =
          Block(modes[a], modes[b]);
    }
  }
  return dense;
}

std::vector<std::vector<int>> JointCovariance::Components() const {
  // Union-find, every set by its first mode.
  std::vector<int> parent(diagonal_.size());
  std::iota(parent.begin(), parent.end(), 0);
  const auto find = [&](int mode) {
    while (parent[static_cast<std::size_t>(mode)] != mode) {
      int& up = parent[static_cast<std::size_t>(mode)];
      up = parent[static_cast<std::size_t>(up)];
      mode = up;
    }
    return mode;
  };
  for (const CrossBlock& block : cross_) {
    const int a = find(block.row);
    const int b = find(block.column);
    parent[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }
  std::vector<std::vector<int>> components;
  std::vector<std::size_t> component_of(diagonal_.size());
  for (int mode = 0; mode < size(); ++mode) {
    const int first = find(mode);
    std::size_t& component = component_of[static_cast<std::size_t>(first)];
    if (first == mode) {
      component = components.size();
      components.emplace_back();
    }
    components[component].push_back(mode);
  }
  return components;
}

std::vector<std::vector<int>> JointCovariance::JointSets() const {
  if (size() > kMaxJointModes) return Components();
  std::vector<int> all(diagonal_.size());
  std::iota(all.begin(), all.end(), 0);
  return {std::move(all)};
}

}  // namespace shiftmap
