// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `ijrr-selectors`: wrong selections, RMSE and time of every selector over the noise, IJRR figures
/// 5 to 7.
void AddIjrrSelectorsExperiment(Application* application);

}  // namespace shiftmap
