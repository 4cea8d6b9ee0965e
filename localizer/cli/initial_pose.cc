// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/initial_pose.h"

#include <cstdio>

#include "localizer/initialization/start_pose.h"

namespace shiftmap {

std::optional<PoseWithCovariance> ParseInitialPose(const std::string& text) {
  double x = 0.0;
  double y = 0.0;
  double yaw = 0.0;
  int length = 0;
  const int fields = std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &x, &y, &yaw, &length);
  if (fields != 3 || static_cast<std::size_t>(length) != text.size()) return std::nullopt;
  PoseWithCovariance pose;
  pose.T_map_vehicle = Se2(x, y, yaw);
  pose.cov_T_map_vehicle = Eigen::Vector3d(0.25, 0.25, 0.04).asDiagonal();
  if (!ValidateStart(pose).ok()) return std::nullopt;
  return pose;
}

}  // namespace shiftmap
