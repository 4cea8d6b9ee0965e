// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/decimal.h"

#include <cmath>
#include <optional>

#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

constexpr std::size_t kNanosecondDigits = 9;
constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;
constexpr std::int64_t kMaxSeconds = 7'000'000'000;

bool AllDigits(std::string_view text) {
  return text.find_first_not_of("0123456789") == std::string_view::npos;
}

}  // namespace

StatusOr<Stamp> ParseStamp(std::string_view text) {
  const std::size_t point = text.find('.');
  const std::string_view whole = text.substr(0, point);
  const std::string_view fraction =
      point == std::string_view::npos ? std::string_view() : text.substr(point + 1);
  const std::optional<std::int64_t> seconds = ParseWhole<std::int64_t>(whole);
  if (!AllDigits(whole) || !AllDigits(fraction) || !seconds || *seconds > kMaxSeconds) {
    return InvalidArgument("'{}', expected seconds since the epoch", text);
  }
  const std::string_view finer =
      fraction.size() > kNanosecondDigits ? fraction.substr(kNanosecondDigits) : std::string_view();
  if (finer.find_first_not_of('0') != std::string_view::npos) {
    return InvalidArgument("'{}' is finer than a nanosecond", text);
  }
  std::int64_t nanoseconds = 0;
  for (std::size_t i = 0; i < kNanosecondDigits; ++i) {
    nanoseconds = nanoseconds * 10 + (i < fraction.size() ? fraction[i] - '0' : 0);
  }
  return StampFromNanoseconds(*seconds * kNanosecondsPerSecond + nanoseconds);
}

StatusOr<double> ParseNumber(std::string_view text) {
  const std::optional<double> value = ParseWhole<double>(text);
  if (!value || !std::isfinite(*value)) {
    return InvalidArgument("'{}', expected a number", text);
  }
  return *value;
}

StatusOr<std::int64_t> ParseInteger(std::string_view text) {
  const std::optional<std::int64_t> value = ParseWhole<std::int64_t>(text);
  if (!value) return InvalidArgument("'{}', expected an integer", text);
  return *value;
}

}  // namespace shiftmap
