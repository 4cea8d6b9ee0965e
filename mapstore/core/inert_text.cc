// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/inert_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <iterator>

#include "mapstore/core/utf8.h"

namespace shiftmap {
namespace {

// Characters above U+001F that move the cursor, end a line or turn the direction of writing.
bool IsActive(char32_t c) {
  return (c >= 0x7f && c <= 0x9f) || c == 0x061c || c == 0x200e || c == 0x200f || c == 0x2028 ||
         c == 0x2029 || (c >= 0x202a && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069);
}

void Append(char32_t c, std::string_view bytes, std::string* out) {
  if (c == '\n') {
    *out += "\\n";
  } else if (c == '\r') {
    *out += "\\r";
  } else if (c == '\t') {
    *out += "\\t";
  } else if (c < 0x20) {
    fmt::format_to(std::back_inserter(*out), "\\x{:02x}", static_cast<std::uint32_t>(c));
  } else if (IsActive(c)) {
    fmt::format_to(std::back_inserter(*out), "\\u{:04x}", static_cast<std::uint32_t>(c));
  } else {
    *out += bytes;
  }
}

std::string Inert(std::string_view text, bool keep_line_feeds) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    // Most text is printable ASCII, and goes through at once.
    const auto plain = static_cast<std::size_t>(
        std::find_if(text.begin(), text.end(), [](char c) { return c < ' ' || c > '~'; }) -
        text.begin());
    out += text.substr(0, plain);
    text.remove_prefix(plain);
    if (text.empty()) break;
    const std::string_view rest = text;
    const std::optional<char32_t> c = TakeCodePoint(&text);
    if (!c) {
      fmt::format_to(
          std::back_inserter(out), "\\x{:02x}", static_cast<unsigned char>(rest.front()));
    } else if (*c == '\n' && keep_line_feeds) {
      out += '\n';
    } else {
      Append(*c, rest.substr(0, rest.size() - text.size()), &out);
    }
  }
  return out;
}

}  // namespace

std::string InertLine(std::string_view text) { return Inert(text, false); }

std::string InertText(std::string_view text) { return Inert(text, true); }

std::string EscapeMarkup(std::string_view text) {
  std::string escaped;
  escaped.reserve(text.size());
  for (const char c : text) {
    switch (c) {
      case '&':
        escaped += "&amp;";
        break;
      case '<':
        escaped += "&lt;";
        break;
      case '>':
        escaped += "&gt;";
        break;
      case '"':
        escaped += "&quot;";
        break;
      default:
        escaped += c;
    }
  }
  return escaped;
}

}  // namespace shiftmap
