// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `map-consistency`: whether the covariance of a map is that of its errors (map_consistency.h).
void AddMapConsistencyExperiment(Application* application);

}  // namespace shiftmap
