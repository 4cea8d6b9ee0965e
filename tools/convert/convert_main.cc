// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/convert_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-convert", "Public data sets to run logs");
  shiftmap::AddConvertCommands(&application);
  return application.Main(argc, argv);
}
