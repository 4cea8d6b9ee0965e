// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/selection/mcts.h"
#include "mapstore/cli/application.h"

namespace shiftmap {

/// `--trees`, `--depth`, `--iterations` and `--exploration` of a command with a tree search.
void AddMctsOptions(MctsOptions* options, Command* command);

/// The same for an experiment's document.
Json MctsJson(const MctsOptions& options);

}  // namespace shiftmap
