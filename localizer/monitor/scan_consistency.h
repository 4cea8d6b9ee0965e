// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The estimate after a scan, and how well the scan's observations fitted the one before them.
struct ScanConsistency {
  Stamp stamp;
  PoseWithCovariance pose;
  double nis = 0.0;      ///< Sum of νᵀ S⁻¹ ν over the observations that corrected the pose.
  std::int64_t dof = 0;  ///< Two per observation.
};

/// The poses alone.
std::vector<StampedPose> TrajectoryOf(const std::vector<ScanConsistency>& scans);

/// Writes a line per scan, in CSV: stamp_s, x_m, y_m, yaw_rad; the covariance of the pose by
/// cov_xx, cov_xy, cov_xyaw, cov_yy, cov_yyaw, cov_yawyaw [m, m, rad]; nis, dof. Stamps in
/// microseconds. The file appears whole or not at all. Errors: as AtomicFile.
Status WriteScanConsistency(const std::vector<ScanConsistency>& scans, const std::string& path);

/// Reads such a file; the order of its columns does not matter.
/// Errors: kNotFound if there is no such file; kInvalidArgument with `<path>:<line>` if a column is
/// missing or a cell is no number in range, if stamps go back, or there is no scan.
StatusOr<std::vector<ScanConsistency>> ReadScanConsistency(const std::string& path);

}  // namespace shiftmap
