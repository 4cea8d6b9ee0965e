// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <variant>
#include <vector>

namespace shiftmap {

/// What an experiment measured: named columns, a row per case.
class ResultTable {
 public:
  using Cell = std::variant<std::string, double>;

  explicit ResultTable(std::vector<std::string> columns);

  /// Precondition: as many cells as there are columns.
  void AddRow(std::vector<Cell> cells);

  const std::vector<std::string>& columns() const { return columns_; }
  const std::vector<std::vector<Cell>>& rows() const { return rows_; }

  /// A header and a line per row. Numbers have six significant digits; one that is not finite is
  /// left empty. Text with commas, quotes or line ends is quoted as in RFC 4180.
  std::string ToCsv() const;

  /// As Markdown; bars are escaped.
  std::string ToMarkdown() const;

  /// For people: the same with aligned columns.
  std::string ToText() const;

 private:
  std::vector<std::string> columns_;
  std::vector<std::vector<Cell>> rows_;
};

}  // namespace shiftmap
