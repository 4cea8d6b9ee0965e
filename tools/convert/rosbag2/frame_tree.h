// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Geometry>
#include <map>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/convert/rosbag2/message_value.h"

namespace shiftmap::rosbag2 {

/// A named frame of ROS and its pose in another: T_parent_child.
struct FrameTransform {
  std::string parent;
  std::string child;
  Stamp stamp;
  Eigen::Isometry3d T_parent_child = Eigen::Isometry3d::Identity();
};

/// The transforms of a tf2_msgs/TFMessage. Slashes before names, as ROS 1 had them, are dropped.
/// Errors: kInvalidArgument for numbers that are not finite or a rotation that is not of length 1.
StatusOr<std::vector<FrameTransform>> ReadTransforms(const MessageValue& message);

/// A position and a rotation of a message, fields `PATH.POSITION.x` ... `PATH.ROTATION.w`.
/// Errors: as ReadTransforms().
StatusOr<Eigen::Isometry3d> ReadIsometry(const MessageValue& message,
                                         const std::string& position_path,
                                         const std::string& rotation_path);

/// The name of a frame without a slash before it.
std::string FrameName(std::string name);

/// Frames that do not move against each other, as /tf_static has them.
class FrameTree {
 public:
  /// A later transform of a child replaces an earlier one.
  void Add(const FrameTransform& transform);

  /// T_target_source along the chain of frames between the two.
  /// Errors: kNotFound with the frames that the target is connected to.
  StatusOr<Eigen::Isometry3d> Lookup(const std::string& target, const std::string& source) const;

 private:
  std::map<std::string, FrameTransform> by_child_;
};

}  // namespace shiftmap::rosbag2
