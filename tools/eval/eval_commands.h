// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the commands of shiftmap-eval.
void AddEvalCommands(Application* application);

}  // namespace shiftmap
