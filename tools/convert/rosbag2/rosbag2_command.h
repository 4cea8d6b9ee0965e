// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the command `rosbag2`.
void AddRosbag2Command(Application* application);

}  // namespace shiftmap
