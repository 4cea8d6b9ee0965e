// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The forms of ParseTime() for help and messages.
inline constexpr std::string_view kTimeForms =
    "seconds since the epoch, 2026-01-09, 2026-01-09T06:00Z, 2026-01-09T06:00:30+01:00, -8h, -3d, "
    "now, today, yesterday";

/// A time as a person writes it. All is UTC but for a stated offset.
///
///     1767945900.5                    seconds since the epoch
///     2026-01-09                      the begin of that day
///     2026-01-09T06:00[:30[.25]]      a blank may stand for T; with `Z` or an offset like `+01:00`
///     -8h                             before now: s, m or min, h, d, w
///     now, today, yesterday           today and yesterday are the begin of that day
///
/// @param now  What `now` means.
/// Errors: kInvalidArgument with all forms; also outside of the years 1970 to 2261.
StatusOr<Stamp> ParseTime(std::string_view text, Stamp now);

}  // namespace shiftmap
