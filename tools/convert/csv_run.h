// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

struct CsvRunOptions {
  std::string odometry;      ///< File with stamp_s,v_mps,omega_radps.
  std::string observations;  ///< File with stamp_s,signature and a measurement.
  std::string truth;         ///< File with stamp_s,x_m,y_m,yaw_rad, or empty.
  RunInfo info;
};

struct CsvRun {
  Run run;
  std::vector<StampedPose> truth;

  /// "<file>: column 'battery'", for each that nothing is taken from.
  std::vector<std::string> ignored_columns;
};

/// Reads a run from tables, CSV (RFC 4180) with a row of names first, columns in any order. Rows of
/// a table are in the order of time; stamps are decimal seconds since the epoch, exact to the
/// nanosecond.
///
/// A measurement is range_m,bearing_rad or x_m,y_m; sd_range_m,sd_bearing_rad or sd_x_m,sd_y_m may
/// state its noise, and an empty cell of these that it is not known. Rows of one stamp are one
/// scan. A row without signature and measurement is a scan that saw nothing. One with a measurement
/// alone is a landmark without signature.
///
/// Errors: kNotFound; kUnavailable if a file cannot be read; kInvalidArgument, as
/// `<file>:<line>: ...`, for a column that is not there and a row that is malformed.
StatusOr<CsvRun> ReadCsvRun(const CsvRunOptions& options);

}  // namespace shiftmap
