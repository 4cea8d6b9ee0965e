// SPDX-License-Identifier: Apache-2.0
//
// How text for people is set: as wide as the terminal, and with colour where that is wanted.
#pragma once

#include <string>
#include <string_view>

namespace shiftmap {

/// What a text is set for. The default is a file or a pipe: nothing is cut, nothing is coloured.
struct TextStyle {
  int columns = 0;  ///< Of the terminal; 0: lines may be of any length.
  int rows = 0;     ///< Of the terminal; 0: there may be any number of lines.
  bool colour = false;
};

/// The style of standard output: that of the terminal it is, with COLUMNS and LINES in the
/// environment before its own size, and without colour if NO_COLOR is set to anything. The default
/// style if it is no terminal.
TextStyle StandardOutputStyle();

/// How a part of a text is to stand out on a terminal with colour.
enum class Emphasis {
  kNone,
  kStrong,  ///< A heading.
  kFaint,   ///< What does not count.
  kGood,
  kAlarm,
};

/// `text` with marks around it that only RenderMarks() understands. Marks are control characters,
/// which InertLine() escapes: a name cannot bring its own.
std::string Marked(std::string_view text, Emphasis emphasis);

/// The characters of a marked UTF-8 text that take a column.
std::size_t DisplayWidth(std::string_view text);

/// InertText() of a marked text, with its marks as escape sequences, or without them.
std::string RenderMarks(std::string_view text, bool colour);

/// A marked text with its lines broken at blanks so that none is wider than `columns`; what goes on
/// is indented. A longer word stays whole. `columns` 0: as it is.
std::string Wrapped(std::string_view text, std::size_t columns);

/// The first characters of a plain UTF-8 text, with an ellipsis in the end if it is longer.
std::string Shortened(const std::string& text, std::size_t width);

}  // namespace shiftmap
