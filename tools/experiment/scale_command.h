// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `scale`: time and memory of a build over the size of a simulated site.
void AddScaleExperiment(Application* application);

}  // namespace shiftmap
