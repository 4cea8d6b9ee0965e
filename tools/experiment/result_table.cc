// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/result_table.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "mapstore/cli/aligned_table.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

std::string CellText(const ResultTable::Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  const double number = std::get<double>(cell);
  return std::isfinite(number) ? fmt::format("{:.6g}", number) : std::string();
}

std::string CsvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

std::string CsvLine(const std::vector<std::string>& fields) {
  std::string line;
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (i > 0) line += ',';
    line += CsvField(fields[i]);
  }
  return line + '\n';
}

std::vector<std::string> RowText(const std::vector<ResultTable::Cell>& row) {
  std::vector<std::string> fields;
  for (const ResultTable::Cell& cell : row) fields.push_back(CellText(cell));
  return fields;
}

}  // namespace

ResultTable::ResultTable(std::vector<std::string> columns) : columns_(std::move(columns)) {}

void ResultTable::AddRow(std::vector<Cell> cells) {
  SHIFTMAP_CHECK(
      cells.size() == columns_.size(), "{} cells, {} columns", cells.size(), columns_.size());
  rows_.push_back(std::move(cells));
}

std::string ResultTable::ToCsv() const {
  std::string csv = CsvLine(columns_);
  for (const std::vector<Cell>& row : rows_) csv += CsvLine(RowText(row));
  return csv;
}

std::string ResultTable::ToText() const {
  AlignedTable table(columns_);
  for (const std::vector<Cell>& row : rows_) table.AddRow(RowText(row));
  return table.ToString();
}

}  // namespace shiftmap
