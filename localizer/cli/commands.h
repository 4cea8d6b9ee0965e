// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/cli/application.h"

namespace shiftmap {

/// `run`: localizes a run log, or a live stream of one, on a map.
void AddRunCommand(Application* application);

/// `return`, `fetch`, `upload`, `sync`: what a vehicle exchanges with a map store, or with the map
/// server. With a server, shiftmap-transfer takes the place of this process; it is found in the
/// folder of this process' executable.
/// @param arguments  This process' own, for shiftmap-transfer.
void AddExchangeCommands(Application* application, const std::vector<std::string>& arguments);

/// `serve`: localizes a live vehicle that talks over a Unix socket.
void AddServeCommand(Application* application);

/// `ctl`: says one thing to a service, e.g. `start`, or feeds it a run log.
void AddCtlCommand(Application* application);

}  // namespace shiftmap
