// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds every experiment as a command of shiftmap-experiment. An experiment lives in files of its
/// own, has a function `void Add<Name>Experiment(Application*)`, and is listed in experiments.cc.
/// It writes `<name>.csv`, `<name>.json` and pictures through ExperimentOutput.
void AddExperiments(Application* application);

}  // namespace shiftmap
