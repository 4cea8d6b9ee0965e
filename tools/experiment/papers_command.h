// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `papers`: checks the catalogue of the two papers against the source tree, and writes the page
/// that says item by item what is where and what came out.
void AddPapersCommand(Application* application);

}  // namespace shiftmap
