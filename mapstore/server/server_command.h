// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// What shiftmap-server does: it has no commands.
void AddServerCommand(Application* application);

}  // namespace shiftmap
