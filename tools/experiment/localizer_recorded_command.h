// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-recorded`: every recorded robot on the map of every other one of its data set.
void AddLocalizerRecordedExperiment(Application* application);

}  // namespace shiftmap
