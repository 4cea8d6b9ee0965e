// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds `tiv-removal`: T-IV figure 7.
void AddTivRemovalExperiment(Application* application);

}  // namespace shiftmap
