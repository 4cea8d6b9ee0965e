// SPDX-License-Identifier: Apache-2.0
//
// Inside codec/ only: it is for generated types.
#pragma once

#include <google/protobuf/stubs/logging.h>

#include <climits>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap {

/// Errors: kInvalidArgument if the bytes are not such a message.
template <typename Proto>
Status ParseProto(std::string_view bytes, Proto* message) {
  if (bytes.size() <= INT_MAX &&
      message->ParseFromArray(bytes.data(), static_cast<int>(bytes.size()))) {
    return OkStatus();
  }
  return InvalidArgument(
      "{} bytes that are not a {} message", bytes.size(), Proto::descriptor()->full_name());
}

template <typename Proto>
StatusOr<Proto> ParseProto(std::string_view bytes) {
  const google::protobuf::LogSilencer silencer;  // It prints lines of its own about text.
  Proto message;
  SHIFTMAP_RETURN_IF_ERROR(ParseProto(bytes, &message));
  return message;
}

}  // namespace shiftmap
