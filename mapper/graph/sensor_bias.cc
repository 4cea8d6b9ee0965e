// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/sensor_bias.h"

namespace shiftmap {

Innovation LinearizeBiased(const Observation& observation,
                           const Se2& T_map_vehicle,
                           const Eigen::Vector2d& p_map_landmark,
                           const SensorBias& bias,
                           double mean_squared_bearing,
                           Eigen::Matrix2d* J_bias) {
  Innovation innovation = Linearize(observation, T_map_vehicle, p_map_landmark);
  if (J_bias != nullptr) J_bias->setZero();
  if (observation.kind == Observation::Kind::kCartesian) return innovation;

  // The measured bearing will do in the small term.
  const double range = observation.z.x() - innovation.nu.x();
  const double curvature = observation.z.y() * observation.z.y() - mean_squared_bearing;
  innovation.nu.x() -= bias[1] * curvature * range;
  innovation.nu.y() -= bias[0];
  innovation.H_pose.row(0) *= 1.0 + bias[1] * curvature;
  innovation.H_landmark.row(0) *= 1.0 + bias[1] * curvature;
  if (J_bias != nullptr) *J_bias << 0.0, range * curvature, 1.0, 0.0;
  return innovation;
}

}  // namespace shiftmap
