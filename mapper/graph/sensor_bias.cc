// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/sensor_bias.h"

#include <cmath>

namespace shiftmap {

Innovation LinearizeBiased(const Observation& observation,
                           const Se2& T_map_vehicle,
                           const Eigen::Vector2d& p_map_landmark,
                           const SensorBias& bias,
                           double mean_squared_bearing,
                           Eigen::Matrix<double, 2, 3>* J_bias) {
  Innovation innovation = Linearize(observation, T_map_vehicle, p_map_landmark);
  const double scale = std::exp(bias[kLogRangeScale]);
  if (observation.kind == Observation::Kind::kCartesian) {
    const Eigen::Vector2d read = scale * (observation.z - innovation.nu);
    innovation.nu = observation.z - read;
    innovation.H_pose *= scale;
    innovation.H_landmark *= scale;
    if (J_bias != nullptr) *J_bias << read, Eigen::Matrix2d::Zero();
    return innovation;
  }

  // The measured bearing will do in the small term.
  const double range = observation.z.x() - innovation.nu.x();
  const double curvature = observation.z.y() * observation.z.y() - mean_squared_bearing;
  const double gain = scale * (1.0 + bias[kRangeCurvature] * curvature);
  innovation.nu.x() = observation.z.x() - gain * range;
  innovation.nu.y() -= bias[kBearingOffset];
  innovation.H_pose.row(0) *= gain;
  innovation.H_landmark.row(0) *= gain;
  if (J_bias != nullptr) {
    *J_bias << gain * range, 0.0, scale * range * curvature,  //
        0.0, 1.0, 0.0;
  }
  return innovation;
}

Observation Unbiased(const Observation& observation,
                     const SensorBias& bias,
                     double mean_squared_bearing) {
  Observation unbiased = Corrected(observation, WithBias({}, bias, mean_squared_bearing));
  const double scale = std::exp(bias[kLogRangeScale]);
  if (observation.kind == Observation::Kind::kCartesian) {
    unbiased.z /= scale;
  } else {
    unbiased.z.x() /= scale;
  }
  return unbiased;
}

SensorCalibration WithBias(SensorCalibration sensor,
                           const SensorBias& bias,
                           double mean_squared_bearing) {
  sensor.bearing_offset_rad = bias[kBearingOffset];
  sensor.range_curvature_per_rad2 = bias[kRangeCurvature];
  sensor.mean_squared_bearing_rad2 = mean_squared_bearing;
  return sensor;
}

}  // namespace shiftmap
