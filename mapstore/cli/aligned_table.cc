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

// `2026-01-09 06:00:00` and the like, which tell nothing if they are shortened.
bool LooksLikeTime(const std::string& cell) {
  return cell.size() > 9 && cell[4] == '-' && cell[7] == '-' &&
         cell.find_first_not_of("0123456789-: ") == std::string::npos;
}

// Columns of text are not made narrower than this.
constexpr std::size_t kLeastWidth = 12;
constexpr const char* kMore = "…";  // Stands for columns that are left out.
constexpr std::size_t kGap = 2;

}  // namespace

AlignedTable::AlignedTable(std::vector<std::string> header) {
  rows_.push_back({std::move(header), Emphasis::kStrong});
}

void AlignedTable::AddRow(std::vector<std::string> cells, Emphasis emphasis) {
  SHIFTMAP_CHECK(cells.size() == rows_.front().cells.size(),
                 "{} cells, {} columns",
                 cells.size(),
                 rows_.front().cells.size());
  for (std::string& cell : cells) cell = InertLine(cell);
  rows_.push_back({std::move(cells), emphasis});
}

std::vector<std::size_t> AlignedTable::Widths(const std::vector<bool>& numeric,
                                              std::size_t columns) const {
  std::vector<std::size_t> widths(numeric.size(), 0);
  std::vector<bool> fixed = numeric;
  for (const Row& row : rows_) {
    for (std::size_t j = 0; j < widths.size(); ++j) {
      widths[j] = std::max(widths[j], DisplayWidth(row.cells[j]));
      if (LooksLikeTime(row.cells[j])) fixed[j] = true;
    }
  }
  if (columns == 0) return widths;
  const auto narrow = [&](std::size_t j) {
    return fixed[j] ? widths[j] : std::min(widths[j], kLeastWidth);
  };
  const std::size_t all = widths.size();
  std::size_t least = 0;
  for (std::size_t j = 0; j < all; ++j) least += narrow(j) + (j > 0 ? kGap : 0);
  while (widths.size() > 1 && least + (widths.size() < all ? kGap + 1 : 0) > columns) {
    least -= narrow(widths.size() - 1) + kGap;
    widths.pop_back();
  }
  std::size_t total = widths.size() < all ? kGap + 1 : 0;
  for (std::size_t j = 0; j < widths.size(); ++j) total += widths[j] + (j > 0 ? kGap : 0);
  while (total > columns) {
    std::size_t widest = widths.size();
    for (std::size_t j = 0; j < widths.size(); ++j) {
      const bool shrinks = widths[j] > narrow(j);
      if (shrinks && (widest == widths.size() || widths[j] > widths[widest])) widest = j;
    }
    if (widest == widths.size()) break;
    --widths[widest];
    --total;
  }
  return widths;
}

std::string AlignedTable::ToString(const TextStyle& style, const std::string& none) const {
  return rows() == 0 ? none + "\n" : ToString(style);
}

std::string AlignedTable::ToString(const TextStyle& style) const {
  std::vector<bool> numeric(rows_.front().cells.size(), true);
  for (std::size_t i = 1; i < rows_.size(); ++i) {
    for (std::size_t j = 0; j < numeric.size(); ++j) {
      if (!LooksNumeric(rows_[i].cells[j])) numeric[j] = false;
    }
  }
  const auto columns = static_cast<std::size_t>(std::max(style.columns, 0));
  const std::vector<std::size_t> widths = Widths(numeric, columns);
  std::string text;
  for (const Row& row : rows_) {
    std::string line;
    for (std::size_t j = 0; j < widths.size(); ++j) {
      if (j > 0) line.append(kGap, ' ');
      const std::string cell = Shortened(row.cells[j], widths[j]);
      const std::string padding(widths[j] - DisplayWidth(cell), ' ');
      line += numeric[j] ? padding + cell : cell + padding;
    }
    if (widths.size() < row.cells.size()) line += std::string(kGap, ' ') + kMore;
    line.erase(line.find_last_not_of(' ') + 1);
    if (columns > 0) line = Shortened(line, columns);
    text += (style.colour ? Marked(line, row.emphasis) : line) + '\n';
  }
  return text;
}

}  // namespace shiftmap
