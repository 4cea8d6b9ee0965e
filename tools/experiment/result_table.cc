// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/result_table.h"

#include <fmt/format.h>

#include <cmath>
#include <utility>

#include "mapstore/cli/aligned_table.h"
#include "mapstore/core/csv.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

std::string CellText(const ResultTable::Cell& cell) {
  if (const auto* text = std::get_if<std::string>(&cell)) return *text;
  const double number = std::get<double>(cell);
  return std::isfinite(number) ? fmt::format("{:.6g}", number) : std::string();
}

std::string CsvLine(const std::vector<ResultTable::Cell>& cells) {
  std::string line;
  for (const ResultTable::Cell& cell : cells) {
    if (&cell != &cells.front()) line += ',';
    const bool is_text = std::holds_alternative<std::string>(cell);
    line += is_text ? CsvText(std::get<std::string>(cell)) : CellText(cell);
  }
  return line + '\n';
}

std::string MarkdownLine(const std::vector<std::string>& fields) {
  std::string line = "|";
  for (const std::string& field : fields) {
    line += ' ';
    for (const char c : field) {
      if (c == '|' || c == '<') line += '\\';
      line += c;
    }
    line += " |";
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
  std::string csv = CsvLine({columns_.begin(), columns_.end()});
  for (const std::vector<Cell>& row : rows_) csv += CsvLine(row);
  return csv;
}

std::string ResultTable::ToMarkdown() const {
  std::string page = MarkdownLine(columns_);
  page += MarkdownLine(std::vector<std::string>(columns_.size(), "---"));
  for (const std::vector<Cell>& row : rows_) page += MarkdownLine(RowText(row));
  return page;
}

std::string ResultTable::ToText() const {
  AlignedTable table(columns_);
  for (const std::vector<Cell>& row : rows_) table.AddRow(RowText(row));
  return table.ToString();
}

}  // namespace shiftmap
