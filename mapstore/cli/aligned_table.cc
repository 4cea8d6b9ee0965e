// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/aligned_table.h"

#include <algorithm>
#include <charconv>
#include <utility>

#include "mapstore/core/inert_text.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// A number, or the dash that stands for a missing one.
bool LooksNumeric(const std::string& cell) {
  if (cell.empty() || cell == "-") return true;
  double value = 0.0;
  const char* end = cell.data() + cell.size();
  return std::from_chars(cell.data(), end, value).ptr == end;
}

// Characters, not bytes, so that µ and ü do not shift a column.
std::size_t DisplayWidth(const std::string& text) {
  return static_cast<std::size_t>(
      std::count_if(text.begin(), text.end(), [](char c) { return (c & 0xC0) != 0x80; }));
}

}  // namespace

AlignedTable::AlignedTable(std::vector<std::string> header) { rows_.push_back(std::move(header)); }

void AlignedTable::AddRow(std::vector<std::string> cells) {
  SHIFTMAP_CHECK(cells.size() == rows_.front().size(),
                 "{} cells, {} columns",
                 cells.size(),
                 rows_.front().size());
  for (std::string& cell : cells) cell = InertLine(cell);
  rows_.push_back(std::move(cells));
}

std::string AlignedTable::ToString() const {
  const std::size_t columns = rows_.front().size();
  std::vector<std::size_t> widths(columns, 0);
  std::vector<bool> numeric(columns, true);
  for (std::size_t i = 0; i < rows_.size(); ++i) {
    for (std::size_t j = 0; j < columns; ++j) {
      widths[j] = std::max(widths[j], DisplayWidth(rows_[i][j]));
      if (i > 0 && !LooksNumeric(rows_[i][j])) numeric[j] = false;
    }
  }
  std::string text;
  for (const std::vector<std::string>& row : rows_) {
    std::string line;
    for (std::size_t j = 0; j < columns; ++j) {
      if (j > 0) line += "  ";
      const std::string padding(widths[j] - DisplayWidth(row[j]), ' ');
      line += numeric[j] ? padding + row[j] : row[j] + padding;
    }
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + '\n';
  }
  return text;
}

}  // namespace shiftmap
