// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace shiftmap::rosbag2 {

/// The definition of a message type as of ROS 2 Humble and later (vision_msgs 4), for bags that
/// hold none: those in SQLite before ROS 2 Iron. Empty for a type that no conversion reads.
/// @param type  "nav_msgs/msg/Odometry" or "nav_msgs/Odometry".
std::string BuiltinDefinition(std::string_view type);

}  // namespace shiftmap::rosbag2
