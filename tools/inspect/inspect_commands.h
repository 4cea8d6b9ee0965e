// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/cli/application.h"

namespace shiftmap {

/// Adds the commands of shiftmap-inspect.
void AddInspectCommands(Application* application);

// The same by what they are about. Those of the last four write.
void AddListCommands(Application* application);     ///< areas, versions, sightings
void AddLedgerCommands(Application* application);   ///< reports, audit
void AddMapCommands(Application* application);      ///< show, modes, history, vehicles
void AddPictureCommands(Application* application);  ///< export, plot
void AddRunCommands(Application* application);      ///< runs
void AddEditCommands(Application* application);     ///< edit
void AddVersionCommands(Application* application);  ///< diff, publish, rollback
void AddMaintenanceCommands(
    Application* application);  ///< verify, backup, restore, compact, migrate

}  // namespace shiftmap
