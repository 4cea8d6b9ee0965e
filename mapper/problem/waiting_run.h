// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/alignment/explain_alignment.h"

namespace shiftmap {

/// A run that waits: it may lie at several places in the map, and nothing decides between them.
struct WaitingRun {
  std::string name;
  std::string sha256;  ///< Of the log file.
  Explanations explanations;
};

}  // namespace shiftmap
