// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace shiftmap {

/// `text` as one line that a terminal or a log shows and does not obey. Names come from logs,
/// reports and files, and may hold any bytes.
///
/// Line feed, carriage return and tab become `\n`, `\r`, `\t`; other control characters below
/// U+0020 and bytes that are not UTF-8 become `\x1b`; DEL, the control characters U+0080 to U+009F,
/// line separators and marks of writing direction become `\u009b`. All else stays, a backslash too,
/// so that applying it twice changes nothing more.
std::string InertLine(std::string_view text);

/// The same, but line feeds stay. The escapes in it are those of JSON where a JSON document can
/// have the character: such a document stays one, with the same values.
std::string InertText(std::string_view text);

/// Text for HTML and XML, between tags or in the double quotes of an attribute.
/// The characters `&`, `<`, `>` and `"` are replaced by their entities.
/// Other characters, an apostrophe among them, stay.
std::string EscapeMarkup(std::string_view text);

}  // namespace shiftmap
