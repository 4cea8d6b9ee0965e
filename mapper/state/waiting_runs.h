// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/alignment/explain_alignment.h"

namespace shiftmap {

/// Runs that wait: they agree with each other, may lie at several places in the map, and nothing
/// decides between these.
struct WaitingRuns {
  struct Run {
    std::string name;
    std::string sha256;  ///< Of the log file.
  };

  std::vector<Run> runs;
  Explanations explanations;
};

}  // namespace shiftmap
