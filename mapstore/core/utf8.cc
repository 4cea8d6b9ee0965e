// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/utf8.h"

#include <cstddef>
#include <cstdint>

#include "proto/core/check.h"

namespace shiftmap {
namespace {

struct Lead {
  std::size_t continuation_bytes;
  std::uint32_t bits;      // Of the code point, from the lead byte.
  std::uint32_t smallest;  // Code point that needs this many bytes.
};

Lead ParseLead(unsigned char byte) {
  if (byte < 0x80) return {0, byte, 0};
  if ((byte & 0xe0) == 0xc0) return {1, byte & 0x1fU, 0x80};
  if ((byte & 0xf0) == 0xe0) return {2, byte & 0x0fU, 0x800};
  if ((byte & 0xf8) == 0xf0) return {3, byte & 0x07U, 0x10000};
  return {0, 0, 1};  // Below `smallest`: not a lead byte.
}

// The code point whose lead byte is taken; `rest` begins behind it.
std::optional<char32_t> Continue(const Lead& lead, std::string_view rest) {
  if (rest.size() < lead.continuation_bytes) return std::nullopt;
  std::uint32_t code_point = lead.bits;
  for (std::size_t i = 0; i < lead.continuation_bytes; ++i) {
    const auto byte = static_cast<unsigned char>(rest[i]);
    if ((byte & 0xc0) != 0x80) return std::nullopt;
    code_point = code_point << 6 | (byte & 0x3fU);
  }
  const bool surrogate = code_point >= 0xd800 && code_point <= 0xdfff;
  if (code_point < lead.smallest || surrogate || code_point > 0x10ffff) return std::nullopt;
  return static_cast<char32_t>(code_point);
}

}  // namespace

std::optional<char32_t> TakeCodePoint(std::string_view* text) {
  SHIFTMAP_CHECK(!text->empty(), "no byte left");
  const Lead lead = ParseLead(static_cast<unsigned char>(text->front()));
  text->remove_prefix(1);
  const std::optional<char32_t> code_point = Continue(lead, *text);
  if (code_point) text->remove_prefix(lead.continuation_bytes);
  return code_point;
}

bool IsUtf8(std::string_view text) {
  while (!text.empty()) {
    if (!TakeCodePoint(&text)) return false;
  }
  return true;
}

}  // namespace shiftmap
