// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `nights`: days and nights of simulated sites, through the commands of a site (nights.h).
void AddNightsExperiment(Application* application);

}  // namespace shiftmap
