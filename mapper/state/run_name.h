// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// How a build refers to a run that it may not have mapped.
struct RunName {
  std::string name;
  std::string sha256;  ///< Of the log file.
};

}  // namespace shiftmap
