// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `localizer-consistency`: whether the covariance of a pose says what its error is.
void AddLocalizerConsistencyExperiment(Application* application);

}  // namespace shiftmap
