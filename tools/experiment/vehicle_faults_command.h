// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `vehicle-faults`.
void AddVehicleFaultsExperiment(Application* application);

}  // namespace shiftmap
