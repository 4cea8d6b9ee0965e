// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <charconv>
#include <optional>
#include <string_view>
#include <system_error>

namespace shiftmap {

/// The number that a text is as a whole, in the notation of std::from_chars, which knows `inf` and
/// `nan`; nothing if it is anything else, or does not fit.
template <typename Number>
std::optional<Number> ParseWhole(std::string_view text) {
  Number value = {};
  const char* const end = text.data() + text.size();
  const auto [rest, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && rest == end ? std::optional(value) : std::nullopt;
}

}  // namespace shiftmap
