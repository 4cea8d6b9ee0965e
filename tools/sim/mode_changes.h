// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>
#include <vector>

#include "mapstore/core/ids.h"
#include "proto/core/status.h"
#include "tools/sim/random.h"

namespace shiftmap {

/// How landmarks move from run to run.
struct ModeChanges {
  /// Between two runs each landmark moves to another of its places with this probability.
  double change_probability = 0.25;

  /// In each run each landmark is away altogether with this probability.
  double absent_probability = 0.0;
};

/// Where each landmark stands, by run and group: at first at any of its places alike.
/// @param modes  Number of places by group, each > 0.
std::vector<std::vector<ModeNumber>> DrawStates(std::span<const int> modes,
                                                int runs,
                                                const ModeChanges& changes,
                                                Random* random);

/// Checks states that somebody states. Errors: kInvalidArgument unless there is a place or 0 for
/// each landmark of each run.
Status CheckStates(std::span<const std::vector<ModeNumber>> states,
                   std::span<const int> modes,
                   int runs);

}  // namespace shiftmap
