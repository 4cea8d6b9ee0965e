// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `recurring-chains`: how well learned mode chains predict real things that jump between states.
void AddRecurringChainsExperiment(Application* application);

}  // namespace shiftmap
