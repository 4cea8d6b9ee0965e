// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/version.h"

namespace shiftmap {

std::string SoftwareVersion() { return SHIFTMAP_VERSION; }

}  // namespace shiftmap
