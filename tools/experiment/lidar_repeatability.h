// SPDX-License-Identifier: Apache-2.0
//
// Whether the points that are found in one lidar scan are found in another one of the same place.
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/convert/lidar_log.h"
#include "tools/lidar/lidar_observations.h"

namespace shiftmap {

struct RepeatabilityOptions {
  LidarFrontEndOptions front_end;

  /// A point is found again if another one is as near. [m]
  double found_within_m = 0.2;

  /// Scans overlap if they are from poses as near, and if the second has in view as large a share
  /// of what the first hit. [m], [-]
  double max_distance_m = 4.0;
  double min_overlap = 0.5;

  /// A point is in view of a scan if no beam beside it ends as far before it. [m]
  double occluded_by_m = 0.3;

  std::uint64_t seed = 1;  ///< Of the random points.
};

/// Over all pairs of overlapping scans whose poses are so far apart.
struct Repeatability {
  std::string points;           ///< What was looked for.
  double min_distance_m = 0.0;  ///< Between the poses.
  double max_distance_m = 0.0;
  std::int64_t pairs = 0;    ///< Of scans, either way.
  std::int64_t in_view = 0;  ///< Points of the first that are in view of the second.
  std::int64_t found = 0;
  double squares_m2 = 0.0;  ///< Squared distances of those found, summed.

  double Share() const;
  double RmsDistance() const;  ///< Of those found. [m]
};

/// The finders of points that are compared: "flirt", and as many points for each scan of "range
/// gradient", the largest differences of neighbouring ranges, each at the nearer beam, and of
/// "random", any returns. None are closer than min_separation_m.
/// @param log  With the poses that scans are compared by, one per scan.
/// Errors: kInvalidArgument if the log has another number of poses than of scans, or options are
/// out of range.
StatusOr<std::vector<Repeatability>> MeasureRepeatability(const LidarLog& log,
                                                          const RepeatabilityOptions& options);

}  // namespace shiftmap
