// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/csv.h"

#include <algorithm>

namespace shiftmap {
namespace {

constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";

// A text that a spreadsheet would compute, behind any number of apostrophes.
bool IsFormula(std::string_view text) {
  const std::size_t first = text.find_first_not_of('\'');
  return first != std::string_view::npos &&
         std::string_view("=+-@\t\r").find(text[first]) != std::string_view::npos;
}

class Parser {
 public:
  explicit Parser(std::string_view text) : rest_(text) {}

  bool AtEnd() const { return rest_.empty(); }

  // Skips a line that holds no record.
  bool SkipLine() {
    const std::size_t length = std::min(rest_.find('\n'), rest_.size());
    const std::string_view line = rest_.substr(0, length);
    if (!line.empty() && line != "\r" && line.front() != '#') return false;
    rest_.remove_prefix(std::min(rest_.size(), length + 1));
    ++line_;
    return true;
  }

  StatusOr<CsvRecord> Record() {
    CsvRecord record{line_, {}};
    do {
      std::string& cell = record.cells.emplace_back();
      const bool quoted = rest_.starts_with('"');
      SHIFTMAP_RETURN_IF_ERROR(quoted ? Quoted(&cell) : Plain(&cell));
    } while (Take(","));
    if (Take("\r\n") || Take("\n")) ++line_;
    return record;
  }

 private:
  bool Take(std::string_view token) {
    if (!rest_.starts_with(token)) return false;
    rest_.remove_prefix(token.size());
    return true;
  }

  Status Plain(std::string* cell) {
    const std::size_t length = std::min(rest_.find_first_of(",\n"), rest_.size());
    std::string_view text = rest_.substr(0, length);
    rest_.remove_prefix(length);
    if (text.ends_with('\r') && !rest_.starts_with(',')) text.remove_suffix(1);
    if (text.find('"') != std::string_view::npos) {
      return InvalidArgument("line {}: a quote inside a cell without quotes", line_);
    }
    *cell = text;
    return OkStatus();
  }

  Status Quoted(std::string* cell) {
    const int begin = line_;
    rest_.remove_prefix(1);
    for (;;) {
      const std::size_t quote = rest_.find('"');
      if (quote == std::string_view::npos) {
        return InvalidArgument("line {}: a quote that is not closed", begin);
      }
      const std::string_view part = rest_.substr(0, quote);
      line_ += static_cast<int>(std::count(part.begin(), part.end(), '\n'));
      *cell += part;
      rest_.remove_prefix(quote + 1);
      if (!Take("\"")) break;
      *cell += '"';
    }
    const bool ends = rest_.empty() || rest_.starts_with(',') || rest_.starts_with('\n') ||
                      rest_.starts_with("\r\n");
    if (ends) return OkStatus();
    return InvalidArgument("line {}: text behind a quoted cell", line_);
  }

  std::string_view rest_;
  int line_ = 1;
};

}  // namespace

StatusOr<std::vector<CsvRecord>> ParseCsv(std::string_view text) {
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  std::vector<CsvRecord> records;
  Parser parser(text);
  while (!parser.AtEnd()) {
    if (parser.SkipLine()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(CsvRecord record, parser.Record());
    records.push_back(std::move(record));
  }
  return records;
}

std::string CsvText(std::string_view text) {
  std::string cell = IsFormula(text) ? "'" : "";
  cell += text;
  const bool comment = cell.starts_with('#');
  if (!comment && cell.find_first_of(",\"\r\n") == std::string::npos) return cell;
  std::string quoted = "\"";
  for (const char c : cell) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + '"';
}

std::string TextOfCsv(std::string_view cell) {
  if (cell.starts_with('\'') && IsFormula(cell)) cell.remove_prefix(1);
  return std::string(cell);
}

}  // namespace shiftmap
