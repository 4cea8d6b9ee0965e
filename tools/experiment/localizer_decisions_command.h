// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-decisions`: how often decisions are wrong, and how late they come.
void AddLocalizerDecisionsExperiment(Application* application);

}  // namespace shiftmap
