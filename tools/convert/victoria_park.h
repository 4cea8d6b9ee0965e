// SPDX-License-Identifier: Apache-2.0
//
// The Victoria Park data set (Guivant, Nebot: "Optimization of the simultaneous localization and
// map-building algorithm for real-time implementation", IEEE T-RA 17(3), 2001): a pick-up truck
// drives 4 km between the trees of a park; trees have no identity. A folder holds
//
//   controls.csv         t_s, speed_mps of the left rear wheel, steering_rad
//   tree_detections.csv  scan, t_s, range_m, bearing_raw from the laser's right, 0..pi
//   gps.csv              t_s, x_m, y_m, with jumps and gaps
//
// The vehicle frame is the middle of the rear axle; the laser is 3.78 m before and 0.5 m beside it.
//
// Errors, of every function: kNotFound if the folder or a file is missing; kInvalidArgument for a
// row that is malformed or goes backwards in time, as `<file>:<line>: ...`; kUnavailable if a file
// cannot be read.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Where the laser is on the truck, and by what GPS fits best the antenna too. [m]
inline const Eigen::Vector2d kVictoriaParkLaser{3.78, 0.5};

struct VictoriaParkOptions {
  std::string dataset_dir;

  /// Noise that observations are logged with. A tree's centre from a few beams 0.5 degrees apart is
  /// no better, and wide or leaning trunks look different from each side. [m], [rad]
  double sd_range_m = 0.3;
  double sd_bearing_rad = 0.015;
};

struct VictoriaParkRun {
  Run run;
  std::int64_t detection_rows = 0;
  std::int64_t stale_rows = 0;  ///< Dropped: left over from an earlier scan.
};

/// Reads the run; every observation is anonymous, in the vehicle frame, with its covariance.
///
/// The table was written from a buffer of fixed size that was not cleared: behind the detections of
/// a scan, which ascend in bearing, come those of earlier scans in their old slots. What a scan
/// shares with the end of the one before it, slot by slot, is therefore stale.
StatusOr<VictoriaParkRun> ReadVictoriaPark(const VictoriaParkOptions& options);

/// A GPS fix in the data set's local frame. [m]
struct GpsFix {
  Stamp stamp;
  Eigen::Vector2d p_gps_antenna = Eigen::Vector2d::Zero();
};

StatusOr<std::vector<GpsFix>> ReadVictoriaParkGps(const std::string& dataset_dir);

}  // namespace shiftmap
