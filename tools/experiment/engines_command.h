// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `engines`: maps of the graph and of the tree engine, side by side on the same simulated sites.
void AddEnginesExperiment(Application* application);

}  // namespace shiftmap
