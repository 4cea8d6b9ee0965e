// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/csv.h"

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <optional>

#include "mapstore/core/inert_text.h"
#include "mapstore/core/utf8.h"

namespace shiftmap {
namespace {

constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";

// A text that a spreadsheet would compute, behind any number of apostrophes.
bool IsFormula(std::string_view text) {
  const std::size_t first = text.find_first_not_of('\'');
  return first != std::string_view::npos &&
         std::string_view("=+-@\t\r").find(text[first]) != std::string_view::npos;
}

// What a terminal would obey as escapes of InertLine(), and a backslash as two of them.
std::string Escaped(std::string_view text) {
  std::string escaped;
  while (!text.empty()) {
    const std::string_view rest = text;
    TakeCodePoint(&text);
    const std::string_view bytes = rest.substr(0, rest.size() - text.size());
    if (bytes == "\\") {
      escaped += "\\\\";
    } else if (bytes == "\r") {
      escaped += "\\x0d";
    } else if (bytes == "\n" || bytes == "\t") {
      escaped += bytes;
    } else {
      escaped += InertLine(bytes);
    }
  }
  return escaped;
}

// The number of `digits` hexadecimal digits at the begin of a text.
std::optional<std::uint32_t> HexOf(std::string_view text, std::size_t digits) {
  if (text.size() < digits) return std::nullopt;
  std::uint32_t value = 0;
  const char* const end = text.data() + digits;
  return std::from_chars(text.data(), end, value, 16).ptr == end ? std::optional(value)
                                                                 : std::nullopt;
}

// In UTF-8, of a code point below U+10000.
std::string BytesOf(std::uint32_t code_point) {
  const auto tail = [](std::uint32_t bits) { return static_cast<char>(0x80 | (bits & 0x3f)); };
  if (code_point < 0x80) return {static_cast<char>(code_point)};
  if (code_point < 0x800) return {static_cast<char>(0xc0 | code_point >> 6), tail(code_point)};
  return {static_cast<char>(0xe0 | code_point >> 12), tail(code_point >> 6), tail(code_point)};
}

// A backslash that begins no escape stays.
std::string Unescaped(std::string_view text) {
  std::string plain;
  while (!text.empty()) {
    const std::size_t length = std::min(text.find('\\'), text.size());
    plain += text.substr(0, length);
    text.remove_prefix(length);
    std::size_t taken = std::min<std::size_t>(text.size(), 1);
    std::string value(text.substr(0, taken));
    if (text.starts_with("\\\\")) {
      taken = 2;
    } else if (const auto byte =
                   text.starts_with("\\x") ? HexOf(text.substr(2), 2) : std::nullopt) {
      value = static_cast<char>(*byte);
      taken = 4;
    } else if (const auto code =
                   text.starts_with("\\u") ? HexOf(text.substr(2), 4) : std::nullopt) {
      value = BytesOf(*code);
      taken = 6;
    }
    plain += value;
    text.remove_prefix(taken);
  }
  return plain;
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
  std::string cell = Escaped(text);
  if (IsFormula(cell)) cell.insert(0, 1, '\'');
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
  return Unescaped(cell);
}

}  // namespace shiftmap
