// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `build`: a map version from run logs.
void AddBuildCommand(Application* application);

/// `import`: a map version from surveyed landmarks.
void AddImportCommand(Application* application);

}  // namespace shiftmap
