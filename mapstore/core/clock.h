// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <string>
#include <string_view>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How far ahead of this host's clock a vehicle's clock may be. [s]
inline constexpr double kDefaultClockToleranceS = 600.0;

/// No vehicle recorded before. A clock that is behind this was never set: it counts from 1970, or
/// with a receiver of GPS from 1980 or 1999.
inline constexpr Stamp kFirstPlausibleStamp =
    std::chrono::sys_days(std::chrono::year(2000) / 1 / 1);

/// This host's clock.
Stamp SystemNow();

/// A stamp to read, in UTC to the second: `2026-01-09 06:00:00`.
std::string FormatUtc(Stamp stamp);

/// Checks that what was recorded does not end in the future. A clock that was wrong once would
/// otherwise be believed for as long as it was ahead.
/// @param what         What ends, e.g. `run log 'a.mcap'`.
/// @param tolerance_s  At least 0. [s]
/// Errors: kInvalidArgument, with both times.
Status CheckNotInFuture(std::string_view what, Stamp end, Stamp now, double tolerance_s);

/// Checks that what was recorded does not begin before kFirstPlausibleStamp: it would count as
/// older than all others. Errors: kInvalidArgument, with the time.
/// @param what  As for CheckNotInFuture.
Status CheckClockWasSet(std::string_view what, Stamp begin);

}  // namespace shiftmap
