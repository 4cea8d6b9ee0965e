// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/experiments.h"

#include "tools/experiment/ijrr_selectors_command.h"

namespace shiftmap {

void AddExperiments(Application* application) { AddIjrrSelectorsExperiment(application); }

}  // namespace shiftmap
