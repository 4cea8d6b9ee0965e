// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `build`: a map version from run logs.
void AddBuildCommand(Application* application);

/// `nightly`: what a fleet left in a folder goes into the maps of its areas.
void AddNightlyCommand(Application* application);

/// `import`: a map version from surveyed landmarks.
void AddImportCommand(Application* application);

}  // namespace shiftmap
