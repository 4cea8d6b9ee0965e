// SPDX-License-Identifier: Apache-2.0
#include "localizer/models/observation_model.h"

#include <algorithm>
#include <cmath>

#include "mapstore/geometry/angle.h"

namespace shiftmap {
namespace {

constexpr double kMinRange = 1e-3;

}  // namespace

Innovation Linearize(const Observation& observation,
                     const Se2& T_map_vehicle,
                     const Eigen::Vector2d& p_map_landmark) {
  const Eigen::Matrix2d R_vehicle_map = T_map_vehicle.Rotation().transpose();
  const Eigen::Vector2d q = R_vehicle_map * (p_map_landmark - T_map_vehicle.translation());

  // q moves with ξ as -(ξx, ξy) - ξyaw (-q.y, q.x).
  Eigen::Matrix<double, 2, 3> dq_dxi;
  dq_dxi << -1.0, 0.0, q.y(), 0.0, -1.0, -q.x();

  Innovation innovation;
  if (observation.kind == Observation::Kind::kCartesian) {
    innovation.nu = observation.z - q;
    innovation.H_pose = dq_dxi;
    innovation.H_landmark = R_vehicle_map;
    return innovation;
  }
  const double range = std::max(q.norm(), kMinRange);
  const Eigen::Vector2d direction = q / range;
  Eigen::Matrix2d dz_dq;
  dz_dq << direction.x(), direction.y(), -direction.y() / range, direction.x() / range;
  innovation.nu = {observation.z.x() - range,
                   WrapAngle(observation.z.y() - std::atan2(q.y(), q.x()))};
  innovation.H_pose = dz_dq * dq_dxi;
  innovation.H_landmark = dz_dq * R_vehicle_map;
  return innovation;
}

Observation Corrected(const Observation& observation, const SensorCalibration& sensor) {
  Observation corrected = observation;
  if (observation.kind == Observation::Kind::kCartesian) return corrected;
  const double bearing = observation.z.y();
  const double gain = 1.0 + sensor.range_curvature_per_rad2 *
                                (bearing * bearing - sensor.mean_squared_bearing_rad2);
  // Far outside the field of view that it was estimated in, the parabola means nothing.
  corrected.z.x() /= std::clamp(gain, 0.5, 2.0);
  corrected.z.y() = WrapAngle(bearing - sensor.bearing_offset_rad);
  return corrected;
}

Eigen::Matrix2d ObservationNoise(const Observation& observation, const SensorCalibration& sensor) {
  if (observation.cov_z) return *observation.cov_z;
  if (observation.kind == Observation::Kind::kCartesian) {
    return Eigen::Matrix2d::Identity() * (sensor.sd_position_m * sensor.sd_position_m);
  }
  const Eigen::Vector2d sd(sensor.sd_range_m, sensor.sd_bearing_rad);
  return sd.cwiseAbs2().asDiagonal();
}

Eigen::Matrix2d PositionNoiseInVehicle(const Observation& observation,
                                       const Eigen::Matrix2d& cov_z) {
  if (observation.kind == Observation::Kind::kCartesian) return cov_z;
  const double range = observation.z.x();
  const double c = std::cos(observation.z.y());
  const double s = std::sin(observation.z.y());
  Eigen::Matrix2d dq_dz;
  dq_dz << c, -range * s, s, range * c;
  return dq_dz * cov_z * dq_dz.transpose();
}

double SquareMetresPerUnit(const Observation& observation) {
  return observation.kind == Observation::Kind::kCartesian ? 1.0 : observation.z.x();
}

}  // namespace shiftmap
