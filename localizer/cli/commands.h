// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `run`: localizes a run log, or a live stream of one, on a map.
void AddRunCommand(Application* application);

/// `return`: hands shift reports back to the map store.
void AddReturnCommand(Application* application);

/// `serve`: localizes a live vehicle that talks over a Unix socket.
void AddServeCommand(Application* application);

/// `ctl`: says one thing to a service, e.g. `start`, or feeds it a run log.
void AddCtlCommand(Application* application);

}  // namespace shiftmap
