// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"
#include "tools/experiment/nights_world.h"

namespace shiftmap {

/// What simulated sites have in common: vehicles, landmarks, size, shifts, seed.
void AddSiteOptions(NightsOptions* nights, Command* command);

/// `nights`: days and nights of simulated sites, through the commands of a site (nights.h).
void AddNightsExperiment(Application* application);

}  // namespace shiftmap
