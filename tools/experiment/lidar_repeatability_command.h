// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `lidar-repeatability`: points of lidar scans that are found again from elsewhere.
void AddLidarRepeatabilityExperiment(Application* application);

}  // namespace shiftmap
