// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <concepts>
#include <vector>

#include "mapper/index.h"

namespace shiftmap {

/// The row of a point's x in a vector or covariance of points, stacked (x, y).
constexpr Eigen::Index RowOf(std::integral auto point) {
  return 2 * static_cast<Eigen::Index>(point);
}
template <typename Tag>
constexpr Eigen::Index RowOf(TypedIndex<Tag> point) {
  return 2 * point;
}

/// Both rows of each point.
template <typename Index>
std::vector<Eigen::Index> RowsOf(const std::vector<Index>& points) {
  std::vector<Eigen::Index> rows;
  for (const Index point : points) rows.insert(rows.end(), {RowOf(point), RowOf(point) + 1});
  return rows;
}

}  // namespace shiftmap
