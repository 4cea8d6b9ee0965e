// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string_view>

#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Numbers from text. The whole text must be the number.
/// Errors: kInvalidArgument with the text.

/// Seconds since the epoch as decimal text, exact to the nanosecond: no rounding through a double.
/// More than nine digits behind the point are an error unless they are zeros; so is a time after
/// 7e9 s (the year 2191), which leaves room to add to it.
StatusOr<Stamp> ParseStamp(std::string_view text);

/// A finite number.
StatusOr<double> ParseNumber(std::string_view text);

StatusOr<std::int64_t> ParseInteger(std::string_view text);

}  // namespace shiftmap
