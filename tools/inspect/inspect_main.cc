// SPDX-License-Identifier: Apache-2.0
#include "tools/inspect/inspect_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-inspect", "Look into map stores");
  shiftmap::AddInspectCommands(&application);
  return application.Main(argc, argv);
}
