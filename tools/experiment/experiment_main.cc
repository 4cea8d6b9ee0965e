// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/experiments.h"

int main(int argc, char** argv) {
  shiftmap::Application application("shiftmap-experiment",
                                    "The papers' figures and tables, and ours");
  shiftmap::AddExperiments(&application);
  return application.Main(argc, argv);
}
