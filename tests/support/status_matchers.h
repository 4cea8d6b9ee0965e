// SPDX-License-Identifier: Apache-2.0
//
// gMock matchers for Status and StatusOr.
#pragma once

#include <gmock/gmock.h>

#include <string>

#include "proto/core/status.h"

namespace shiftmap::testing {

inline const Status& StatusOf(const Status& status) { return status; }

template <typename T>
const Status& StatusOf(const StatusOr<T>& result) {
  return result.status();
}

MATCHER(IsOk, "is OK") {
  *result_listener << StatusOf(arg).ToString();
  return StatusOf(arg).ok();
}

/// An error of `code` whose message contains `substring`.
MATCHER_P2(StatusIs, code, substring, "has the code and the text in its message") {
  *result_listener << StatusOf(arg).ToString();
  return StatusOf(arg).code() == code &&
         Message(StatusOf(arg)).find(substring) != std::string::npos;
}

}  // namespace shiftmap::testing
