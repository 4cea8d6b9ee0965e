// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/inspect_commands.h"

namespace shiftmap {

void AddInspectCommands(Application* application) {
  AddListCommands(application);
  AddLedgerCommands(application);
  AddRunCommands(application);
  AddMapCommands(application);
  AddExportCommand(application);
  AddPlotCommand(application);
  AddViewCommands(application);
  AddEditCommands(application);
  AddVersionCommands(application);
  AddMaintenanceCommands(application);
}

}  // namespace shiftmap
