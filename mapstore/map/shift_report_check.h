// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "mapstore/map/evidence.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Longest text in a report: names, hashes, signatures. [byte]
inline constexpr std::size_t kMaxReportTextBytes = 1024;

/// Largest report. That of a shift has some kilobytes. [byte]
inline constexpr std::size_t kMaxReportBytes = std::size_t{64} << 20;

/// By how much a visit may favour one mode over another: a localizer's bound on what one visit
/// says, log_likelihood of the best mode - log_likelihood of the worst. [nat]
inline constexpr double kMaxVisitLogRatio = 50.0;

/// RFC 4122 text form, in letters of either case.
bool IsUuid(std::string_view text);

/// The form in which UUIDs are compared.
std::string LowerCaseUuid(std::string uuid);

/// 64 hex digits, in lower case.
bool IsSha256Hex(std::string_view text);

/// Checks a name as a report holds it: not empty, UTF-8, at most kMaxReportTextBytes.
/// Errors: kInvalidArgument, starting with `field`.
Status CheckReportText(std::string_view field, std::string_view text);

/// Checks what files and map stores rely on, whoever made the report: a UUID; a named area and
/// version; hashes in hex; bounded UTF-8 text; stamps by ValidateStamp(), in order and within the
/// shift; numbers within kMaxMagnitude; covariances positive definite, variances within
/// kMaxVariance; modes in order, with log-likelihoods within kMaxVisitLogRatio of each other; no
/// two visits of a landmark at the same time.
/// Errors: kInvalidArgument, naming the first field that is wrong as in proto/shift_report.proto.
Status ValidateShiftReport(const ShiftReport& report);

/// Takes out the evidence, decisions and sightings that ValidateShiftReport() refuses, so that one
/// of them does not cost the whole shift; then, if the report may encode to more than `max_bytes`,
/// the sightings of fewest observations, decisions, and visits of fewest observations, in this
/// order. Counts them in `dropped` as `invalid_*` and `excess_*`. The head stays as it is.
void LeaveOutInvalid(ShiftReport* report, std::size_t max_bytes = kMaxReportBytes);

}  // namespace shiftmap
