// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/aligned_table.h"

#include <fmt/ranges.h>

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

// Columns of text are not made narrower than the first, unless they ask for more; the last one that
// fits, than the second.
constexpr std::size_t kReadableWidth = 16;
constexpr std::size_t kLeastWidth = 12;
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

void AlignedTable::KeepWide(std::size_t column, std::size_t least) {
  wide_column_ = column;
  wide_least_ = least;
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
  if (columns > 0) Fit(columns, fixed, &widths);
  return widths;
}

void AlignedTable::Fit(std::size_t columns,
                       const std::vector<bool>& fixed,
                       std::vector<std::size_t>* widths) const {
  const auto narrow = [&](std::size_t j, std::size_t least) {
    return fixed[j] ? (*widths)[j] : std::min((*widths)[j], least);
  };
  const auto readable = [&](std::size_t j) {
    return narrow(j, std::max(kReadableWidth, j == wide_column_ ? wide_least_ : 0));
  };
  std::size_t shown = 0;
  std::size_t used = 0;
  while (shown < widths->size()) {
    const std::size_t begin = used + (shown > 0 ? kGap : 0);
    if (shown > 0 && begin + narrow(shown, kLeastWidth) > columns) break;
    used = begin + readable(shown);
    ++shown;
  }
  widths->resize(shown);
  std::vector<std::size_t> least(shown);
  std::size_t total = kGap * (shown - 1);
  for (std::size_t j = 0; j < shown; ++j) {
    least[j] = j + 1 < shown ? readable(j) : narrow(j, kLeastWidth);
    total += (*widths)[j];
  }
  while (total > columns) {
    std::size_t widest = shown;
    for (std::size_t j = 0; j < shown; ++j) {
      const bool shrinks = (*widths)[j] > least[j];
      if (shrinks && (widest == shown || (*widths)[j] > (*widths)[widest])) widest = j;
    }
    if (widest == shown) break;
    --(*widths)[widest];
    --total;
  }
}

std::string AlignedTable::NotShown(std::size_t shown) const {
  const std::vector<std::string>& header = rows_.front().cells;
  if (shown == header.size()) return "";
  const std::vector<std::string> names(header.begin() + static_cast<std::ptrdiff_t>(shown),
                                       header.end());
  return fmt::format("not shown: {} (| less -S shows all)", fmt::join(names, ", "));
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
    line.erase(line.find_last_not_of(' ') + 1);
    if (columns > 0) line = Shortened(line, columns);
    text += (style.colour ? Marked(line, row.emphasis) : line) + '\n';
  }
  const std::string rest = NotShown(widths.size());
  if (rest.empty()) return text;
  const Emphasis faint = style.colour ? Emphasis::kFaint : Emphasis::kNone;
  return text + Wrapped(Marked(rest, faint), columns) + '\n';
}

}  // namespace shiftmap
