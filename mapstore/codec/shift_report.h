// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/map/evidence.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Shift report as Protobuf bytes (proto/shift_report.proto); the same report gives the same bytes.
std::string EncodeShiftReport(const ShiftReport& report);

/// Decodes and checks an untrusted report: sizes, finite numbers, UUID, times in order.
/// Errors: kInvalidArgument naming the field.
StatusOr<ShiftReport> DecodeShiftReport(const std::string& bytes);

/// The same from and to a file; written to a temporary file, fsync, rename.
/// Errors: as DecodeShiftReport, and kNotFound, kUnavailable. Messages start with `shift report
/// 'PATH': `.
StatusOr<ShiftReport> ReadShiftReport(const std::string& path);
Status WriteShiftReport(const ShiftReport& report, const std::string& path);

/// A random UUID, RFC 4122 version 4, in text form.
std::string RandomUuid();

}  // namespace shiftmap
