// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/rosbag2/pose_odometry.h"

#include <Eigen/Core>

namespace shiftmap::rosbag2 {

std::vector<OdometrySample> OdometryOfPoses(std::span<const StampedPose> poses) {
  std::vector<OdometrySample> samples;
  const StampedPose* last = nullptr;
  for (const StampedPose& pose : poses) {
    if (last != nullptr && pose.stamp > last->stamp) {
      const double seconds = ToSeconds(pose.stamp - last->stamp);
      const Eigen::Vector3d twist = (last->T_map_vehicle.Inverse() * pose.T_map_vehicle).Log();
      samples.push_back({last->stamp, twist.x() / seconds, twist.z() / seconds});
    }
    last = &pose;
  }
  if (last == nullptr) return samples;
  OdometrySample end = samples.empty() ? OdometrySample{} : samples.back();
  end.stamp = last->stamp;
  samples.push_back(end);
  return samples;
}

}  // namespace shiftmap::rosbag2
