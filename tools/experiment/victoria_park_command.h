// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `victoria-park`: 4 km between trees without identity, against GPS.
void AddVictoriaParkExperiment(Application* application);

}  // namespace shiftmap
