// SPDX-License-Identifier: Apache-2.0
#include "mapstore/cli/version.h"

namespace shiftmap {

std::string SoftwareVersion() { return SHIFTMAP_VERSION; }

std::string SoftwareRevision() { return SHIFTMAP_REVISION; }

}  // namespace shiftmap
