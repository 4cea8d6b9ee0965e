// SPDX-License-Identifier: Apache-2.0
//
// One drive of a loader through a mine: motion, odometry, lidar scans and observations.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <numbers>
#include <vector>

#include "mapstore/map/calibration.h"
#include "proto/core/status.h"
#include "tools/lidar/lidar_observations.h"
#include "tools/sim/loader.h"
#include "tools/sim/mine_site.h"
#include "tools/sim/path_driver.h"
#include "tools/sim/simulated_lidar.h"
#include "tools/sim/simulated_world.h"

namespace shiftmap {

/// White noise that is added to each sample of a log; the motion does not have it. T-IV (30).
struct VelocityNoise {
  double sd_v_mps = 0.0;        ///< [m/s]
  double sd_omega_radps = 0.0;  ///< [rad/s]
};

/// That of T-IV IX-E, at 20 samples per second.
inline constexpr VelocityNoise kTIvOdometryNoise{0.1, 5.0 / 180.0 * std::numbers::pi};

struct MineDriveOptions {
  std::vector<Eigen::Vector2d> path = {};  ///< Empty: the plan's. Crosses no rock. [m]
  PathDriverOptions driver;
  LoaderOptions loader;
  Stamp start = StampFromSeconds(1767600000.0);
  double max_duration_s = 3600.0;  ///< The drive ends then where it is. [s]

  double odometry_rate_hz = 20.0;
  double scan_rate_hz = 5.0;  ///< At most the odometry's; scans coincide with odometry.

  /// How the true motion follows from what odometry says before its white noise: scales, lag and
  /// random walk, as in OpenWorldOptions.
  OdometryCalibration odometry{.noise_v = 0.01, .noise_omega = 0.01};
  VelocityNoise odometry_noise;

  /// Reads the signatures of barriers and tags, from the origin of the vehicle frame, where nothing
  /// is in between. Its densities are not used.
  SensorCalibration tag_sensor{.sd_range_m = 0.1,
                               .sd_bearing_rad = 0.02,
                               .max_range_m = 20.0,
                               .max_bearing_rad = 1.5,
                               .detection_probability = 0.8};
  double clutter_per_scan = 0.0;  ///< As in OpenWorldOptions.

  /// On the front body, whose motion odometry reports. None: nothing is scanned.
  std::vector<SimulatedLidar> lidars = {};

  /// The scans of the first lidar are in the log.
  bool log_scans = false;

  /// The interest points of the scans are observations, too. The front end's sensor is not used:
  /// each lidar has its own. Walls of tunnels are seen at flat angles, where hits lie far apart:
  /// they are one surface across wider gaps than in rooms.
  bool points = false;
  LidarFrontEndOptions front_end{
      .sensor = {}, .points = {.max_gap_m = 0.5}, .max_point_range_m = 20.0};

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// Checks that a path can be driven. Errors: kInvalidArgument unless it has two points or more,
/// none twice in a row, and crosses no wall.
Status CheckPath(const std::vector<Eigen::Vector2d>& path, const std::vector<Wall>& rock);

/// A front and a rear lidar, half a circle each.
std::vector<SimulatedLidar> FrontAndRearLidar();

struct LidarRanges {
  Stamp stamp;
  std::size_t lidar = 0;         ///< Index in MineDriveOptions::lidars.
  std::vector<double> ranges_m;  ///< One per beam.
};

struct SimulatedDrive {
  /// The log: noisy odometry; per scan first what the tag sensor saw, then the interest points.
  SimulatedRun simulated;

  std::vector<OdometrySample> true_odometry;  ///< Without white noise; at every odometry stamp.
  std::vector<double> articulation_rad;       ///< Likewise.
  std::vector<LidarRanges> ranges;            ///< By stamp, then lidar.
};

/// Simulates one drive.
/// @param active_mode  By group of the site: where each landmark stands. Those of corners do not
///                     count, they follow from the version.
/// Determinism: the same input gives the same bits. The motion does not depend on the sensors, nor
/// what the tag sensor sees on the lidars.
/// Errors: as Validate() and CheckPath(); kInvalidArgument if the active modes do not fit the site.
StatusOr<SimulatedDrive> SimulateDrive(const MineSite& site,
                                       PlanVersion version,
                                       const std::vector<ModeNumber>& active_mode,
                                       const MineDriveOptions& options,
                                       std::uint64_t seed);

}  // namespace shiftmap
