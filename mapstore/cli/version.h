// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// The version of this build, e.g. "0.1.0".
std::string SoftwareVersion();

}  // namespace shiftmap
