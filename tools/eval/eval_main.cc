// SPDX-License-Identifier: Apache-2.0
#include "tools/eval/eval_commands.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-eval", "Errors of estimates against the truth");
  shiftmap::AddEvalCommands(&application);
  return application.Main(argc, argv);
}
