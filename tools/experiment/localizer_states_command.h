// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-states`: what the localizer reports of simulated shifts with known causes.
void AddLocalizerStatesExperiment(Application* application);

}  // namespace shiftmap
