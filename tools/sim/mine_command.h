// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds `mine`.
void AddMineCommand(Application* application);

}  // namespace shiftmap
