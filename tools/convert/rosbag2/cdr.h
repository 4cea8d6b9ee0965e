// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

#include "proto/core/status.h"
#include "tools/convert/rosbag2/message_definition.h"
#include "tools/convert/rosbag2/message_value.h"

namespace shiftmap::rosbag2 {

/// Decodes a message as ROS 2 serializes it: XCDR1 of either byte order behind four bytes that name
/// it. Memory grows with the bytes that are there, some ten times as many; no count is believed
/// before its elements are there.
/// @param definition  Must outlive the value.
/// Errors: kInvalidArgument with the type's name if the bytes are of another encoding, end before
/// the message does, go on behind it, or are too many.
StatusOr<MessageValue> DecodeCdr(const MessageDefinition& definition, std::string_view bytes);

}  // namespace shiftmap::rosbag2
