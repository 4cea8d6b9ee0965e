// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/mcts_options.h"

#include <nlohmann/json.hpp>

namespace shiftmap {

void AddMctsOptions(MctsOptions* options, Command* command) {
  command
      ->Option("--trees",
               &options->trees,
               "Trees of a search, side by side, of which each has its share of the iterations")
      .InRange(1, 256)
      .Option("--depth", &options->depth, "Steps that a search looks ahead; IJRR 8.2.2: 25")
      .InRange(1, 1e6)
      .Option("--iterations",
              &options->iterations,
              "Sequences that a search tries for a step; IJRR 8.2.2: 200")
      .InRange(1, 1e9)
      .Option("--exploration", &options->exploration, "C_p of IJRR (25)")
      .InRange(1e-9, 1e9);
}

Json MctsJson(const MctsOptions& options) {
  return {{"trees", options.trees},
          {"depth", options.depth},
          {"iterations", options.iterations},
          {"exploration", options.exploration}};
}

}  // namespace shiftmap
