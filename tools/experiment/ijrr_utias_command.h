// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `ijrr-utias`: recorded runs among displaced landmarks, IJRR 8.2 and 8.3.
void AddIjrrUtiasExperiment(Application* application);

}  // namespace shiftmap
