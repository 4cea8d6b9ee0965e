// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `fleet-nights`: the areas of a fleet in one store, night after night, with one broken odometer.
void AddFleetNightsExperiment(Application* application);

}  // namespace shiftmap
