// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/run/run.h"
#include "proto/core/status.h"
#include "tools/convert/rosbag2/detections.h"

namespace shiftmap::rosbag2 {

/// Which covariance an observation states.
enum class CovarianceModel {
  kProject,       ///< The detection's, turned into the vehicle frame, without its height.
  kNone,          ///< None: the sensor's calibration holds.
  kFixed,         ///< One standard deviation in x and in y.
  kRangeBearing,  ///< From standard deviations of range and bearing, as the sensor sees them.
};

struct Rosbag2Options {
  std::string path;  ///< A bag's folder or a file of it.

  std::string odometry_topic;                  ///< Empty: the only one there is.
  std::vector<std::string> detections_topics;  ///< Empty: the only one there is.

  /// Velocities are differences of an Odometry's poses, for drivers that fill in these alone.
  bool odometry_from_pose = false;

  std::string vehicle = "robot";
  std::string area;
  std::string run_uuid;

  std::string vehicle_frame;  ///< Empty: the one that the odometry's twist is in.

  /// T_vehicle_sensor of every sensor, instead of what /tf_static says.
  std::optional<Eigen::Isometry3d> mount;

  bool log_time = false;  ///< Stamps are when messages were recorded, not what their headers say.

  DetectionOptions detections;

  CovarianceModel covariance = CovarianceModel::kProject;
  double sd_m = 0.1;             ///< Of kFixed, > 0. [m]
  double sd_range_m = 0.1;       ///< Of kRangeBearing, > 0. [m]
  double sd_bearing_rad = 0.02;  ///< Of kRangeBearing, > 0. [rad]
};

/// A run and what of the bag it was made from.
struct Rosbag2Run {
  Run run;
  std::string odometry_topic;
  std::vector<std::string> detections_topics;
  std::string vehicle_frame;
  std::map<std::string, Eigen::Isometry3d> T_vehicle_sensor;  ///< By frame of the sensor.
  bool builtin_definitions = false;     ///< The bag has no definition of one of the types.
  std::int64_t late_items = 0;          ///< Put in order: stamps before that of the item before.
  std::int64_t dropped_detections = 0;  ///< Positions that are not finite, AprilTags without one.
  std::int64_t without_covariance = 0;  ///< Observations whose detection states none.
  std::int64_t sideways = 0;            ///< Odometry with a velocity to the side, above 0.1 m/s.
  std::vector<std::string> truncations;
};

/// Reads a bag: nav_msgs/Odometry or geometry_msgs/TwistStamped, and vision_msgs/Detection3DArray,
/// fiducial_msgs/FiducialTransformArray or apriltag_msgs/AprilTagDetectionArray, the last with the
/// positions on /tf. One message of detections is one scan, also if it has none. Observations with
/// a covariance are positions in the vehicle frame, those without are range and bearing, so that
/// the sensor's calibration fits. Height is dropped.
///
/// Errors: as Bag; kInvalidArgument if a topic cannot be chosen, a message is malformed, or the run
/// takes more than a quarter of MemoryBound(); kNotFound if a frame is not connected to the
/// vehicle.
StatusOr<Rosbag2Run> ReadRosbag2(const Rosbag2Options& options);

}  // namespace shiftmap::rosbag2
