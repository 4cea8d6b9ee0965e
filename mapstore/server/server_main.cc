// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/server_command.h"

int main(int argc, char** argv) {
  shiftmap::Application application(
      "shiftmap-server", "Gives vehicles their maps, and takes their shift reports and run logs");
  shiftmap::AddServerCommand(&application);
  return application.Main(argc, argv);
}
