// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-localizer",
                                    "Localizes a vehicle on a map whose landmarks move");
  shiftmap::AddRunCommand(&application);
  shiftmap::AddServeCommand(&application);
  shiftmap::AddCtlCommand(&application);
  shiftmap::AddExchangeCommands(&application, {argv + 1, argv + argc});
  return application.Main(argc, argv);
}
