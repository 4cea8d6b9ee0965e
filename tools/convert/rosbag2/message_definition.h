// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <string_view>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap::rosbag2 {

/// What a field of a ROS 2 message holds, one or many of it.
struct MessageField {
  enum class Kind {
    kBool,
    kInt8,
    kUint8,  ///< Also char and byte.
    kInt16,
    kUint16,
    kInt32,
    kUint32,
    kInt64,
    kUint64,
    kFloat32,
    kFloat64,
    kString,
    kMessage,
  };
  enum class Count { kOne, kFixed, kSequence };

  std::string name;
  Kind kind = Kind::kBool;
  Count count = Count::kOne;
  std::size_t fixed_count = 1;  ///< Of kFixed, >= 1.
  std::size_t message = 0;      ///< Of kMessage: its type, an index of MessageDefinition::types().
};

struct MessageType {
  std::string name;  ///< "nav_msgs/Odometry", without "msg".
  std::vector<MessageField> fields;
};

/// A message type and all types that it is made of. No type contains itself.
class MessageDefinition {
 public:
  /// Parses a definition as bags hold it ("ros2msg"): the text of the .msg file, then for each type
  /// that it needs a line of `=`, a line `MSG: package/Type` and that type's text. Constants,
  /// defaults and bounds are read and dropped.
  /// @param type  "nav_msgs/msg/Odometry" or "nav_msgs/Odometry".
  /// Errors: kInvalidArgument with `definition of <type>: ` if the text is not of this form, needs
  /// a type that is not there, contains itself or is too large; or has a wstring, which is not
  /// read.
  static StatusOr<MessageDefinition> Parse(std::string_view type, std::string_view text);

  const MessageType& root() const { return types_.front(); }
  const std::vector<MessageType>& types() const { return types_; }

 private:
  std::vector<MessageType> types_;
};

/// "nav_msgs/Odometry" of "nav_msgs/msg/Odometry" and of itself.
std::string ShortTypeName(std::string_view type);

}  // namespace shiftmap::rosbag2
