// SPDX-License-Identifier: Apache-2.0
//
// The UTIAS Multi-Robot Cooperative Localization and Mapping data set (MRCLAM): Leung, Halpern,
// Barfoot, Liu, "The UTIAS multi-robot cooperative localization and mapping dataset", IJRR 30(8),
// 2011. A folder holds Barcodes.dat, Landmark_Groundtruth.dat and, per robot N,
// RobotN_Odometry.dat, RobotN_Measurement.dat and RobotN_Groundtruth.dat.
//
// Subjects are numbered anew in each data set, barcodes are not: a landmark's signature is its
// barcode in decimal. Subjects 1 to 5 are the robots; they move, so seeing one is no observation of
// a landmark.
//
// Errors, of every function: kNotFound if the folder or a file is missing; kInvalidArgument for a
// row that is malformed or goes backwards in time, as `<file>:<line>: ...`; kUnavailable if a file
// cannot be read.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/run/run.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

struct UtiasOptions {
  std::string dataset_dir;
  int robot = 1;  ///< 1 to 5.

  /// The stretch to read, from the first odometry stamp on: start included, end not. [s]
  double start_s = 0.0;
  std::optional<double> duration_s;  ///< Nothing: to the end.
};

/// A run and the rows it was made from; rows outside of the stretch do not count.
struct UtiasRun {
  Run run;
  std::int64_t odometry_rows = 0;
  std::int64_t measurement_rows = 0;
  std::int64_t robot_measurements = 0;     ///< Dropped: of another robot.
  std::int64_t unlisted_measurements = 0;  ///< Dropped: Barcodes.dat does not list the barcode.
};

/// Reads one robot's odometry and measurements. Stamps are exact. Rows with one stamp form one
/// scan; a scan of which every row was dropped stays, empty: the camera looked. Errors also:
/// kInvalidArgument if the robot's number is not 1..5 or the stretch has no odometry.
StatusOr<UtiasRun> ReadUtias(const UtiasOptions& options);

/// Reads one robot's motion-capture poses, in the frame of the landmarks' ground truth.
StatusOr<std::vector<StampedPose>> ReadUtiasGroundtruth(const std::string& dataset_dir, int robot);

/// Reads where the landmarks stand, by signature. [m]
StatusOr<std::map<Signature, Eigen::Vector2d>> ReadUtiasLandmarks(const std::string& dataset_dir);

}  // namespace shiftmap
