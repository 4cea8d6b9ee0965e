// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `groupings`: the same days of simulated sites with builds and returns grouped in several ways,
/// each against one batch of all runs.
void AddGroupingsExperiment(Application* application);

}  // namespace shiftmap
