// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the commands of shiftmap-inspect. None of them writes to a store.
void AddInspectCommands(Application* application);

// The same by what they look at.
void AddListCommands(Application* application);     ///< areas, versions, runs, sightings
void AddMapCommands(Application* application);      ///< show, modes, history
void AddPictureCommands(Application* application);  ///< export, plot

}  // namespace shiftmap
