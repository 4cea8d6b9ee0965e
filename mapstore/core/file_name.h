// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace shiftmap {

/// Whether a character stands for itself in the file names that are made of foreign text: letters,
/// digits, `_`, `-`, and a dot that is not the first one.
bool IsFileNameCharacter(char c, bool first);

/// A file name for any text, different for different texts, in the letters `A-Za-z0-9._=-`:
/// other bytes become `=` and two hex digits, and so does a dot at the begin. A name that would be
/// longer than 100 bytes is cut, and ends with the text's SHA-256.
std::string FileNameOf(std::string_view text);

}  // namespace shiftmap
