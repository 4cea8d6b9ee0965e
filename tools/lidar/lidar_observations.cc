// SPDX-License-Identifier: Apache-2.0
#include "tools/lidar/lidar_observations.h"

#include <cmath>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

Observation ToObservation(const InterestPoint& point, const LidarFrontEndOptions& options) {
  const double range = point.p_lidar.norm();
  const Eigen::Matrix2d R_vehicle_beam =
      options.sensor.T_vehicle_lidar.Rotation() *
      Se2(0.0, 0.0, std::atan2(point.p_lidar.y(), point.p_lidar.x())).Rotation();
  const Eigen::Vector2d sd(options.sd_range_m, options.sd_bearing_rad * range);
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = options.sensor.T_vehicle_lidar * point.p_lidar;
  observation.cov_z =
      Symmetrized(R_vehicle_beam * sd.cwiseAbs2().asDiagonal() * R_vehicle_beam.transpose() +
                  options.sd_place_m * options.sd_place_m * Eigen::Matrix2d::Identity());
  return observation;
}

}  // namespace

Status LidarFrontEndOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(sensor.Validate());
  SHIFTMAP_RETURN_IF_ERROR(points.Validate());
  if (!(max_point_range_m > 0.0)) {
    return InvalidArgument("max_point_range_m {}, expected > 0", max_point_range_m);
  }
  if (!(sd_range_m > 0.0) || !(sd_bearing_rad > 0.0) || !(sd_place_m >= 0.0)) {
    return InvalidArgument(
        "sd_range_m {}, sd_bearing_rad {}, sd_place_m {}, expected > 0, > 0, >= 0",
        sd_range_m,
        sd_bearing_rad,
        sd_place_m);
  }
  return OkStatus();
}

Scan ObserveInterestPoints(Stamp stamp,
                           std::span<const double> ranges_m,
                           const LidarFrontEndOptions& options) {
  Scan scan{stamp, {}};
  for (const InterestPoint& point :
       DetectInterestPoints(ranges_m, options.sensor, options.points)) {
    if (point.p_lidar.norm() > options.max_point_range_m) continue;
    scan.observations.push_back(ToObservation(point, options));
  }
  return scan;
}

}  // namespace shiftmap
