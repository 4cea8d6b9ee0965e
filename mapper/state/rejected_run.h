// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// A run that could not be used, and why.
struct RejectedRun {
  std::string name;
  std::string reason;
};

}  // namespace shiftmap
