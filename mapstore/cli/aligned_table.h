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

  /// A column of text that is narrower than `least` only where it is the last one that fits.
  void KeepWide(std::size_t column, std::size_t least);

  std::size_t rows() const { return rows_.size() - 1; }

  /// Header and rows, one line each. If they are wider than the terminal, the widest columns of
  /// text (not of times) are shortened, with an ellipsis in the end. If that is not enough, the
  /// last columns are left out, and a last line names them: what matters most goes first. With
  /// colour, emphasis is there as Marked() text.
  std::string ToString(const TextStyle& style = {}) const;

  /// Likewise; without a row, the line `none` instead, which says what there is none of.
  std::string ToString(const TextStyle& style, const std::string& none) const;

 private:
  // Of the columns that are shown: as wide as the cells, but where the terminal is narrower.
  std::vector<std::size_t> Widths(const std::vector<bool>& numeric, std::size_t columns) const;

  // Leaves the first columns that fit, where those that are not fixed may be narrower.
  void Fit(std::size_t columns,
           const std::vector<bool>& fixed,
           std::vector<std::size_t>* widths) const;

  // Names the columns behind the first `shown` ones, or is nothing.
  std::string NotShown(std::size_t shown) const;

  struct Row {
    std::vector<std::string> cells;
    Emphasis emphasis = Emphasis::kNone;
  };
  std::vector<Row> rows_;
  std::size_t wide_column_ = 0;
  std::size_t wide_least_ = 0;
};

}  // namespace shiftmap
