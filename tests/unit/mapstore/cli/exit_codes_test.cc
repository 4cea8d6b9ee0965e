// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/exit_codes.h"

#include <gtest/gtest.h>

#include <utility>

namespace shiftmap {
namespace {

TEST(ExitCodes, FollowTheTableOfStatusCodes) {
  const std::pair<StatusCode, int> table[] = {
      {StatusCode::kOk, 0},
      {StatusCode::kInvalidArgument, 3},
      {StatusCode::kDataLoss, 3},
      {StatusCode::kFailedPrecondition, 3},
      {StatusCode::kOutOfRange, 3},
      {StatusCode::kPermissionDenied, 3},
      {StatusCode::kUnauthenticated, 3},
      {StatusCode::kUnimplemented, 3},
      {StatusCode::kAborted, 4},
      {StatusCode::kAlreadyExists, 5},
      {StatusCode::kNotFound, 6},
      {StatusCode::kInternal, 70},
      {StatusCode::kUnknown, 70},
      {StatusCode::kUnavailable, 75},
      {StatusCode::kDeadlineExceeded, 75},
      {StatusCode::kResourceExhausted, 75},
  };
  for (const auto& [code, expected] : table) {
    EXPECT_EQ(static_cast<int>(ExitCodeFor(Status(code, "message"))), expected)
        << static_cast<int>(code);
  }
}

}  // namespace
}  // namespace shiftmap
