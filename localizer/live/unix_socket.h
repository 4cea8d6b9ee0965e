// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/core/owned_fd.h"
#include "proto/core/status.h"

namespace shiftmap::live {

/// Listens on a Unix stream socket at a path; its owner and group may connect. The socket file that
/// a dead process left is replaced.
/// Errors: kInvalidArgument if the path is too long or something other than a socket is there;
/// kNotFound if its folder is not there; kUnavailable if another process listens there, or the
/// system refuses. Messages start with `socket 'PATH': `.
StatusOr<OwnedFd> ListenAt(const std::string& path);

/// Connects to it. Errors: kInvalidArgument as above; kNotFound if nobody listens there.
StatusOr<OwnedFd> ConnectTo(const std::string& path);

}  // namespace shiftmap::live
