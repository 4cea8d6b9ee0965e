// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `lidar-run`: buildings mapped by the interest points of a lidar, without identities.
void AddLidarRunExperiment(Application* application);

}  // namespace shiftmap
