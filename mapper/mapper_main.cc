// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-mapper",
                                    "Builds maps of places whose landmarks move");
  shiftmap::AddBuildCommand(&application);
  shiftmap::AddNightlyCommand(&application);
  shiftmap::AddImportCommand(&application);
  return application.Main(argc, argv);
}
