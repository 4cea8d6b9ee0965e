// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the command `csv`.
void AddCsvCommand(Application* application);

}  // namespace shiftmap
