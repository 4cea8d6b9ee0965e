// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace shiftmap {

/// A table for people: columns as wide as their widest cell, two blanks between them. Columns of
/// numbers are aligned to the right. Cells are shown as InertLine() of them, so that a row is a
/// line.
class AlignedTable {
 public:
  explicit AlignedTable(std::vector<std::string> header);

  /// Precondition: as many cells as the header has.
  void AddRow(std::vector<std::string> cells);

  /// Header and rows, one line each.
  std::string ToString() const;

 private:
  std::vector<std::vector<std::string>> rows_;
};

}  // namespace shiftmap
