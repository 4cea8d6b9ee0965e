// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/clock.h"

#include <fmt/chrono.h>

#include <chrono>
#include <ctime>

namespace shiftmap {

Stamp SystemNow() {
  return std::chrono::time_point_cast<Duration>(std::chrono::system_clock::now());
}

std::string FormatUtc(Stamp stamp) {
  // to_time_t() would go by nanoseconds, of which the first second of all has too few.
  const auto seconds = std::chrono::floor<std::chrono::seconds>(stamp).time_since_epoch();
  return fmt::format("{:%Y-%m-%d %H:%M:%S}",
                     fmt::gmtime(static_cast<std::time_t>(seconds.count())));
}

Status CheckNotInFuture(std::string_view what, Stamp end, Stamp now, double tolerance_s) {
  // Compared in seconds: stamps from outside may be further apart than nanoseconds count.
  const double ahead_s = ToSecondsSinceEpoch(end) - ToSecondsSinceEpoch(now);
  if (ahead_s <= tolerance_s) return OkStatus();
  return InvalidArgument(
      "{}: ends at {} UTC, but it is {} UTC: {:.0f} s ahead, expected at most {:.0f}",
      what,
      FormatUtc(end),
      FormatUtc(now),
      ahead_s,
      tolerance_s);
}

Status CheckClockWasSet(std::string_view what, Stamp begin) {
  if (begin >= kFirstPlausibleStamp) return OkStatus();
  return InvalidArgument(
      "{}: begins at {} UTC, as if the vehicle's clock was not set", what, FormatUtc(begin));
}

}  // namespace shiftmap
