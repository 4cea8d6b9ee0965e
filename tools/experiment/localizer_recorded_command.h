// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-recorded`: every recorded robot on the map of every other one of its data set; and
/// the second part of its run on the map that its first part is in too, with its own calibration
/// and with the fleet's.
void AddLocalizerRecordedExperiment(Application* application);

}  // namespace shiftmap
