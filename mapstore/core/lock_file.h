// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/core/owned_fd.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Of an errno about a path: kNotFound, or kInvalidArgument for a path that can be no file's;
/// another attempt mends neither. Else kUnavailable: a disk that is full or not yet mounted.
StatusCode PathErrorCode(int error);

/// Makes a file unless it is there, and holds it against others, in this process and in others, as
/// long as the descriptor is open, so at most as long as the process. Waits for nobody: nothing if
/// somebody else holds it. The file stays.
/// Errors: kNotFound if there is no such folder; kInvalidArgument for a path that can be no file's;
/// kUnavailable if the file cannot be opened. Messages start with `lock 'PATH': `.
StatusOr<std::optional<OwnedFd>> LockFile(const std::string& path);

/// Whether an open file is still the one at a path: before it was locked, somebody may have removed
/// or renamed it.
bool IsFileAt(int fd, const std::string& path);

}  // namespace shiftmap
