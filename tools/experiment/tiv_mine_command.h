// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds `tiv-mine` (T-IV figure 6) and `tiv-posterior` (figure 8).
void AddTivMineExperiments(Application* application);

}  // namespace shiftmap
