// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/planar_observation.h"

#include <Eigen/Core>
#include <cmath>
#include <optional>

#include "mapstore/geometry/covariance.h"

namespace shiftmap::rosbag2 {
namespace {

// Σ = sd_r² u uᵀ + (r sd_b)² n nᵀ with the direction u from the sensor to the landmark.
Eigen::Matrix2d OfRangeBearing(const Eigen::Vector2d& from_sensor, const Rosbag2Options& options) {
  const double range_m = from_sensor.norm();
  const Eigen::Vector2d along =
      range_m > 0.0 ? Eigen::Vector2d(from_sensor / range_m) : Eigen::Vector2d::UnitX();
  const Eigen::Vector2d across(-along.y(), along.x());
  const double sd_across_m = range_m * options.sd_bearing_rad;
  return options.sd_range_m * options.sd_range_m * along * along.transpose() +
         sd_across_m * sd_across_m * across * across.transpose();
}

std::optional<Eigen::Matrix2d> Covariance(const Detection& detection,
                                          const Eigen::Vector2d& p_vehicle,
                                          const Eigen::Isometry3d& T_vehicle_sensor,
                                          const Rosbag2Options& options) {
  switch (options.covariance) {
    case CovarianceModel::kNone:
      return std::nullopt;
    case CovarianceModel::kFixed:
      return Eigen::Matrix2d(options.sd_m * options.sd_m * Eigen::Matrix2d::Identity());
    case CovarianceModel::kRangeBearing:
      return OfRangeBearing(p_vehicle - T_vehicle_sensor.translation().head<2>(), options);
    case CovarianceModel::kProject:
      break;
  }
  if (!detection.cov_p) return std::nullopt;
  const Eigen::Matrix3d R = T_vehicle_sensor.linear();
  const Eigen::Matrix2d cov = (R * *detection.cov_p * R.transpose()).topLeftCorner<2, 2>();
  return Eigen::Matrix2d(0.5 * (cov + cov.transpose()));
}

}  // namespace

Observation ToPlanar(const Detection& detection,
                     const Eigen::Isometry3d& T_vehicle_sensor,
                     const Rosbag2Options& options) {
  const Eigen::Vector2d p_vehicle = (T_vehicle_sensor * detection.p_frame_landmark).head<2>();
  Observation observation;
  observation.signature = detection.signature;
  observation.cov_z = Covariance(detection, p_vehicle, T_vehicle_sensor, options);
  if (observation.cov_z && !IsSymmetricPositiveDefinite(*observation.cov_z)) {
    observation.cov_z.reset();
  }
  const double range_m = p_vehicle.norm();
  if (observation.cov_z || range_m == 0.0) {
    observation.kind = Observation::Kind::kCartesian;
    observation.z = p_vehicle;
  } else {
    observation.z = {range_m, std::atan2(p_vehicle.y(), p_vehicle.x())};
  }
  return observation;
}

}  // namespace shiftmap::rosbag2
