// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// A record of a CSV text.
struct CsvRecord {
  int line = 0;  ///< On which it begins, from 1.
  std::vector<std::string> cells;
};

/// Splits a text into records (RFC 4180): cells between commas, a quoted cell with `""` for a
/// quote, line ends of either kind. Empty lines and lines that begin with `#` outside of quotes are
/// skipped, and so is a byte order mark. Cells of text that came from CsvText() are as they were
/// before with TextOfCsv().
/// Errors: kInvalidArgument with `line <n>`, for a quote that is not closed, that stands inside a
/// cell without quotes, or behind which more follows.
StatusOr<std::vector<CsvRecord>> ParseCsv(std::string_view text);

/// A cell of text, quoted where it must be. A spreadsheet computes a cell that begins with one of
/// `=+-@`, tab or carriage return: an apostrophe goes before it, and before such a text that begins
/// with apostrophes already. What a terminal would obey is escaped: control characters but line
/// feed and tab, marks of writing direction and bytes that are not UTF-8 as `\x1b` or `\u009b`
/// (InertLine()), a backslash as two. TextOfCsv() restores every text.
std::string CsvText(std::string_view text);

/// A parsed cell of a text column as it was before CsvText(). A backslash that begins no escape of
/// it stays, so that a cell written by hand needs none.
std::string TextOfCsv(std::string_view cell);

}  // namespace shiftmap
