// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-utias`: real robots among landmarks that stand elsewhere than the map believes.
void AddLocalizerUtiasExperiment(Application* application);

}  // namespace shiftmap
