// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "localizer/live/messages.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// Requests and events as Protobuf bytes (proto/live.proto), without a length before them.
std::string EncodeRequest(const Request& request);
std::string EncodeEvent(const Event& event);

/// Decodes what another process sent and checks it: finite numbers, covariances positive definite,
/// names of at most 1024 bytes, stamps not before 1970.
/// Errors: kInvalidArgument. The id of a request that is refused is in `id` if it could be read.
StatusOr<Request> DecodeRequest(std::string_view bytes, std::uint64_t* id);
StatusOr<Event> DecodeEvent(std::string_view bytes);

}  // namespace shiftmap::live
