// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/convert_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application(
      "shiftmap-convert",
      "Logs of robots, and public data sets, to run logs; and checks of run logs");
  shiftmap::AddConvertCommands(&application);
  return application.Main(argc, argv);
}
