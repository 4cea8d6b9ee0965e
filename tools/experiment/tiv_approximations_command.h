// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `tiv-approximations`: T-IV figure 3, and the approximations of T-IV VI-B and
/// VII side by side on simulated drives.
void AddTivApproximationsExperiment(Application* application);

}  // namespace shiftmap
