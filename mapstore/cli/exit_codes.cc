// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/exit_codes.h"

namespace shiftmap {

ExitCode ExitCodeFor(const Status& status) {
  switch (status.code()) {
    case StatusCode::kOk:
      return ExitCode::kDone;
    case StatusCode::kInvalidArgument:
    case StatusCode::kDataLoss:
    case StatusCode::kFailedPrecondition:
    case StatusCode::kOutOfRange:
    case StatusCode::kPermissionDenied:
    case StatusCode::kUnauthenticated:
    case StatusCode::kUnimplemented:
      return ExitCode::kBadInput;
    case StatusCode::kAborted:
      return ExitCode::kConflict;
    case StatusCode::kAlreadyExists:
      return ExitCode::kNothingToDo;
    case StatusCode::kNotFound:
      return ExitCode::kNotFound;
    case StatusCode::kUnavailable:
    case StatusCode::kDeadlineExceeded:
    case StatusCode::kResourceExhausted:
      return ExitCode::kTemporary;
    case StatusCode::kCancelled:
      return ExitCode::kStopped;
    default:
      return ExitCode::kInternal;
  }
}

}  // namespace shiftmap
