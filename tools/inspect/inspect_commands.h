// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the commands of shiftmap-inspect.
void AddInspectCommands(Application* application);

// The same by what they are about.
void AddListCommands(Application* application);      ///< areas, versions, sightings, config
void AddLedgerCommands(Application* application);    ///< reports, audit
void AddMapCommands(Application* application);       ///< show, vehicles, modes, history
void AddLandmarkCommands(Application* application);  ///< modes, history; by AddMapCommands
void AddExportCommand(Application* application);     ///< export
void AddPlotCommand(Application* application);       ///< plot
void AddViewCommands(Application* application);      ///< view
// These write.
void AddRunCommands(Application* application);      ///< runs
void AddEditCommands(Application* application);     ///< edit
void AddVersionCommands(Application* application);  ///< diff, publish, rollback
void AddMaintenanceCommands(
    Application* application);  ///< verify, backup, restore, compact, migrate

}  // namespace shiftmap
