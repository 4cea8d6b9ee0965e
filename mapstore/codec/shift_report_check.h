// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/evidence.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Longest text in a report: names, hashes, signatures. [byte]
inline constexpr std::size_t kMaxReportTextBytes = 1024;

/// Checks what a map store relies on: a UUID, a named area and version, hashes in hex, text of
/// bounded length, finite numbers, positive definite covariances, modes in order, and times in
/// order and within the shift. Errors: kInvalidArgument, naming the first field that is wrong as in
/// proto/shift_report.proto.
Status ValidateShiftReport(const ShiftReport& report);

}  // namespace shiftmap
