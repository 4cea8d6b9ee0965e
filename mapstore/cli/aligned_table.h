// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/text_style.h"

namespace shiftmap {

/// A table for people: columns as wide as their widest cell, two blanks between them. Columns of
/// numbers are aligned to the right. Cells are shown as InertLine() of them, so that a row is a
/// line.
class AlignedTable {
 public:
  explicit AlignedTable(std::vector<std::string> header);

  /// Precondition: as many cells as the header has.
  void AddRow(std::vector<std::string> cells, Emphasis emphasis = Emphasis::kNone);

  std::size_t rows() const { return rows_.size() - 1; }

  /// Header and rows, one line each. If they are wider than the terminal, the widest columns of
  /// text (not of times) are shortened; if that is not enough, the last columns are left out. An
  /// ellipsis is in the place of both. With colour, emphasis is there as Marked() text.
  std::string ToString(const TextStyle& style = {}) const;

  /// Likewise; without a row, the line `none` instead, which says what there is none of.
  std::string ToString(const TextStyle& style, const std::string& none) const;

 private:
  // Of the columns that are shown: as wide as the cells, but where the terminal is narrower.
  std::vector<std::size_t> Widths(const std::vector<bool>& numeric, std::size_t columns) const;

  struct Row {
    std::vector<std::string> cells;
    Emphasis emphasis = Emphasis::kNone;
  };
  std::vector<Row> rows_;
};

}  // namespace shiftmap
