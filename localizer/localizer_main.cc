// SPDX-License-Identifier: Apache-2.0
#include "localizer/cli/commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-localizer",
                                    "Localizes a vehicle on a map whose landmarks move");
  shiftmap::AddRunCommand(&application);
  shiftmap::AddReturnCommand(&application);
  shiftmap::AddServeCommand(&application);
  shiftmap::AddCtlCommand(&application);
  return application.Main(argc, argv);
}
