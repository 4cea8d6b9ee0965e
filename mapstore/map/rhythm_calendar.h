// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <chrono>
#include <cstdint>

#include "mapstore/core/stamp.h"

namespace shiftmap {

inline constexpr Duration kRhythmDay = std::chrono::hours(24);
inline constexpr Duration kRhythmWeek = std::chrono::hours(24 * 7);

/// Time that passes from one stamp to a later one; 0 if it is not later. Stamps further apart than
/// a Duration can say count as far apart as it can.
inline Duration Elapsed(Stamp from, Stamp to) {
  if (to <= from) return Duration::zero();
  const auto elapsed_ns = static_cast<std::uint64_t>(ToNanoseconds(to)) -
                          static_cast<std::uint64_t>(ToNanoseconds(from));
  return Duration(static_cast<std::int64_t>(
      std::min(elapsed_ns, static_cast<std::uint64_t>(Duration::max().count()))));
}

/// A day, or a week from Monday, cut into equal parts. UTC: where clocks are set to summer time,
/// what follows them comes an hour earlier then.
struct RhythmCalendar {
  Duration period = kRhythmDay;  ///< kRhythmDay or kRhythmWeek.
  int phases = 1;                ///< > 0.

  /// How far into its period a time is.
  Duration Into(Stamp stamp) const {
    const std::int64_t length = period.count();
    // The epoch was a Thursday.
    const std::int64_t since_monday =
        period == kRhythmWeek ? 3 * std::int64_t{kRhythmDay.count()} : 0;
    const std::int64_t into = (ToNanoseconds(stamp) % length + length) % length;
    return Duration((into + since_monday) % length);
  }

  /// The part that a time so far into the period is in. Exact integers, so that the parts meet.
  int PhaseOf(Duration into) const {
    return std::min(static_cast<int>(into.count() / (period.count() / phases)), phases - 1);
  }

  /// Where a part ends, from the begin of the period.
  Duration EndOf(int phase) const {
    return phase + 1 == phases ? period : Duration(period.count() / phases * (phase + 1));
  }

  /// Calls `visit(phase, length)` for the parts that [from, from + elapsed) is cut into, in the
  /// order of time.
  template <class Visitor>
  void ForEachPart(Stamp from, Duration elapsed, Visitor visit) const {
    Duration into = Into(from);
    while (elapsed > Duration::zero()) {
      const int phase = PhaseOf(into);
      const Duration length = std::min(elapsed, EndOf(phase) - into);
      visit(phase, length);
      elapsed -= length;
      into += length;
      if (into == period) into = Duration::zero();
    }
  }
};

}  // namespace shiftmap
