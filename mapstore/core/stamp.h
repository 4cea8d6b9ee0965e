// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cmath>
#include <cstdint>

namespace shiftmap {

/// A span of time in integer nanoseconds.
using Duration = std::chrono::nanoseconds;

/// A point in time: nanoseconds since the Unix epoch, UTC, by the clock of whoever made the log.
using Stamp = std::chrono::sys_time<Duration>;

/// Seconds in a duration. Exact to about 1 ns for spans below 100 days.
inline double ToSeconds(Duration duration) {
  return std::chrono::duration<double>(duration).count();
}

/// The duration nearest to `seconds`.
/// Precondition: |seconds| < 9.2e9 (292 years).
inline Duration FromSeconds(double seconds) { return Duration(std::llround(seconds * 1e9)); }

/// Nanoseconds since the epoch, as files store them.
inline std::int64_t ToNanoseconds(Stamp stamp) { return stamp.time_since_epoch().count(); }

inline Stamp StampFromNanoseconds(std::int64_t stamp_ns) { return Stamp(Duration(stamp_ns)); }

/// Seconds since the epoch; rounds to about 0.2 µs for stamps of our century.
inline double ToSecondsSinceEpoch(Stamp stamp) { return ToSeconds(stamp.time_since_epoch()); }

inline Stamp StampFromSeconds(double seconds) { return Stamp(FromSeconds(seconds)); }

}  // namespace shiftmap
