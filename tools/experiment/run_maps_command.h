// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `run-maps`: whether the covariance of a run mapped by itself is honest (run_maps.h).
void AddRunMapsExperiment(Application* application);

}  // namespace shiftmap
