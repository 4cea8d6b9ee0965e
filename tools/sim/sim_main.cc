// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/sim_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-sim", "Simulated worlds and shifts, with truth");
  shiftmap::AddSimCommands(&application);
  return application.Main(argc, argv);
}
