// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `layout-pairs`: which frames explain recorded runs in two layouts, by search and by enumeration.
void AddLayoutPairsExperiment(Application* application);

}  // namespace shiftmap
