// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/time_text.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <optional>
#include <string>

#include "mapstore/core/day.h"
#include "mapstore/core/parse_whole.h"

namespace shiftmap {
namespace {

// What a stamp can hold.
constexpr double kMaxSeconds = 9.2e9;

std::optional<double> Number(std::string_view text) {
  const std::optional<double> value = ParseWhole<double>(text);
  return value && std::isfinite(*value) ? value : std::nullopt;
}

// Takes `digits` digits off the front.
std::optional<int> TakeDigits(std::size_t digits, std::string_view* text) {
  if (text->size() < digits) return std::nullopt;
  int value = 0;
  for (const char c : text->substr(0, digits)) {
    if (c < '0' || c > '9') return std::nullopt;
    value = 10 * value + (c - '0');
  }
  text->remove_prefix(digits);
  return value;
}

bool Take(char c, std::string_view* text) {
  if (!text->starts_with(c)) return false;
  text->remove_prefix(1);
  return true;
}

// `HH:MM`, in seconds. @param colon  Whether the colon must be there.
std::optional<double> TakeHoursAndMinutes(bool colon, std::string_view* text) {
  const std::optional<int> hours = TakeDigits(2, text);
  if (!Take(':', text) && colon) return std::nullopt;
  const std::optional<int> minutes = TakeDigits(2, text);
  if (!hours || !minutes || *hours > 23 || *minutes > 59) return std::nullopt;
  return 3600.0 * *hours + 60.0 * *minutes;
}

// What follows `HH:MM`: seconds, and the offset from UTC. Adds both.
bool TakeSecondsAndOffset(std::string_view text, double* time_s) {
  if (Take(':', &text)) {
    const std::size_t end = std::min(text.find_first_not_of("0123456789."), text.size());
    const std::optional<double> seconds = Number(text.substr(0, end));
    if (!seconds || *seconds >= 60.0 || end < 2) return false;
    *time_s += *seconds;
    text.remove_prefix(end);
  }
  if (text.empty() || text == "Z" || text == "z") return true;
  const double sign = text.front() == '-' ? -1.0 : 1.0;
  if (!Take('+', &text) && !Take('-', &text)) return false;
  const std::optional<double> offset = TakeHoursAndMinutes(false, &text);
  if (!offset || !text.empty()) return false;
  *time_s -= sign * *offset;
  return true;
}

std::optional<double> DateSeconds(std::string_view text) {
  const std::optional<int> year = TakeDigits(4, &text);
  if (!year || !Take('-', &text)) return std::nullopt;
  const std::optional<int> month = TakeDigits(2, &text);
  if (!month || !Take('-', &text)) return std::nullopt;
  const std::optional<int> day = TakeDigits(2, &text);
  if (!day) return std::nullopt;
  const std::chrono::year_month_day date{std::chrono::year(*year),
                                         std::chrono::month(static_cast<unsigned>(*month)),
                                         std::chrono::day(static_cast<unsigned>(*day))};
  if (!date.ok()) return std::nullopt;
  double time_s =
      std::chrono::duration<double>(std::chrono::sys_days(date).time_since_epoch()).count();
  if (text.empty()) return time_s;
  if (!Take('T', &text) && !Take('t', &text) && !Take(' ', &text)) return std::nullopt;
  const std::optional<double> of_day = TakeHoursAndMinutes(true, &text);
  if (!of_day) return std::nullopt;
  time_s += *of_day;
  return TakeSecondsAndOffset(text, &time_s) ? std::optional(time_s) : std::nullopt;
}

// `-8h` and the like.
std::optional<double> RelativeSeconds(std::string_view text, double now_s) {
  if (text.size() < 3 || text.front() != '-' || text[1] < '0' || text[1] > '9') {
    return std::nullopt;
  }
  const std::size_t unit = std::min(text.find_first_not_of("0123456789.", 1), text.size());
  const std::optional<double> count = Number(text.substr(1, unit - 1));
  if (!count) return std::nullopt;
  const std::string_view name = text.substr(unit);
  if (name == "s") return now_s - *count;
  if (name == "m" || name == "min") return now_s - 60.0 * *count;
  if (name == "h") return now_s - 3600.0 * *count;
  if (name == "d") return now_s - kSecondsPerDay * *count;
  if (name == "w") return now_s - 7.0 * kSecondsPerDay * *count;
  return std::nullopt;
}

std::optional<double> TimeSeconds(std::string_view text, Stamp now) {
  const double now_s = ToSecondsSinceEpoch(now);
  const double today_s = kSecondsPerDay * std::floor(now_s / kSecondsPerDay);
  if (text == "now") return now_s;
  if (text == "today") return today_s;
  if (text == "yesterday") return today_s - kSecondsPerDay;
  if (const auto seconds = RelativeSeconds(text, now_s)) return seconds;
  if (const auto seconds = Number(text)) return seconds;
  return DateSeconds(text);
}

}  // namespace

StatusOr<Stamp> ParseTime(std::string_view text, Stamp now) {
  if (text == "now") return now;
  const std::optional<double> seconds = TimeSeconds(text, now);
  if (!seconds || *seconds < 0.0 || *seconds > kMaxSeconds) {
    return InvalidArgument(
        "'{}' is no time; expected one of: {} (UTC)", std::string(text), std::string(kTimeForms));
  }
  return StampFromSeconds(*seconds);
}

}  // namespace shiftmap
