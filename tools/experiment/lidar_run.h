// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"
#include "tools/convert/lidar_log.h"
#include "tools/experiment/chart.h"
#include "tools/experiment/victoria_park.h"

namespace shiftmap {

/// For scans seconds apart in rooms: corners stand closer than trees and are seen fewer times, and
/// odometry is as good as that of the Intel robot, by its corrected log (0.072 m/√s, 0.050 rad/√s).
MapperOptions IndoorOptions();

/// Odometry as a vehicle that drives that way could have it: every step of the trajectory with the
/// noise of a random walk, in the vehicle frame. [m/√s], [rad/√s]
std::vector<StampedPose> SimulateOdometry(std::span<const StampedPose> trajectory,
                                          const OdometryCalibration& noise,
                                          std::uint64_t seed);

/// What each method makes of the interest points of a log: "dead reckoning", "filter, nearest",
/// "filter, joint" and "graph, joint". Errors: as BuildMap().
StatusOr<std::vector<ParkResult>> MapLidarRun(const Run& run, const MapperOptions& options);

/// How badly scans of one place fit, without any truth: the median distance of a return from the
/// nearest return of another scan, made a minute or more before from within 2 m and 0.5 rad. [m]
struct RevisitMisfit {
  int pairs = 0;  ///< Of scans. None: the vehicle is nowhere twice.
  double median_m = 0.0;
};
RevisitMisfit MeasureRevisits(const LidarLog& log,
                              std::span<const StampedPose> trajectory,
                              const LidarFrontEndOptions& options);

/// Walls, landmarks and path as a method has them.
Chart DrawLidarMap(const LidarLog& log,
                   const ParkResult& result,
                   const LidarFrontEndOptions& options);

}  // namespace shiftmap
