// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>

namespace shiftmap {

/// The lower triangle of a symmetric matrix whose first rows are kept in full, by columns: a column
/// of the first kFull has all rows, others begin with the row of their number, rounded down to an
/// even one. Even rows are aligned to 16 bytes, so that loops over two rows at a time need no ends.
///
/// What the storage has above the diagonal is mirrored by MirrorFull(), or means nothing.
template <int kRows, int kFull>
class PairedLowerTriangle {
  static_assert(kRows % 2 == 0 && kFull % 2 == 0 && kFull <= kRows);

 public:
  double operator()(int row, int column) const { return Column(column)[row]; }
  double& operator()(int row, int column) { return Column(column)[row]; }

  /// Row r of a column is at [r]; not for rows that are not kept.
  double* Column(int column) { return values_.data() + Begin(column); }
  const double* Column(int column) const { return values_.data() + Begin(column); }

  /// Copies the lower triangle of the first kFull rows to the upper.
  void MirrorFull() {
    for (int column = 0; column < kFull; ++column) {
      for (int row = column + 1; row < kFull; ++row) {
        (*this)(column, row) = (*this)(row, column);
      }
    }
  }

 private:
  // May lie before the first value that the column keeps.
  static constexpr int Begin(int column) {
    if (column < kFull) return column * kRows;
    const int pairs = (column - kFull) / 2;
    const int height = kRows - kFull - 2 * pairs;
    // Columns of the pairs before: 2 Σ (kRows - kFull - 2 i) over i < pairs.
    const int before = 2 * pairs * (kRows - kFull) - 2 * pairs * (pairs - 1);
    return kFull * kRows + before + (column % 2) * height - (kFull + 2 * pairs);
  }

  static constexpr int kValues = kFull * kRows + (kRows - kFull) * (kRows - kFull + 2) / 2;

  alignas(16) std::array<double, static_cast<std::size_t>(kValues)> values_{};
};

}  // namespace shiftmap
