// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "proto/core/status.h"
#include "tools/convert/lidar_log.h"

namespace shiftmap {

/// Reads a JSON file of lidar scans, as logs of the Radish collection are passed on:
///
///     {"map": {"<seconds since the epoch>": {"range": [m, ...], "x": m, "y": m, "theta": rad},
///     ...}}
///
/// The order of the scans in the file does not matter. `poses` has one for each scan.
/// Errors: kNotFound; kUnavailable if the file cannot be read; kInvalidArgument, with the file, for
/// what is no JSON (with line and column), and, with the stamp, for a scan that lacks something,
/// has something of another type, less than two ranges, or the same time as another one.
StatusOr<LidarLog> ReadLidarJson(const std::string& path);

}  // namespace shiftmap
