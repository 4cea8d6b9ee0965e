// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-bodies`: recorded robots on maps in which landmarks are displaced together.
void AddLocalizerBodiesExperiment(Application* application);

}  // namespace shiftmap
