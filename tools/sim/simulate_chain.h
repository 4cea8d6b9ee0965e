// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <random>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// Where a chain was, and from when on.
struct ChainPath {
  std::vector<Stamp> since;  ///< Ascending; the first is the begin.
  std::vector<int> states;

  /// The state at a time; before the begin, the first.
  int At(Stamp stamp) const;
};

/// Draws a path: an exponential time in each state, then a jump in proportion to the rates.
ChainPath SimulateChain(
    const ModeChain& chain, int start, Stamp begin, Stamp end, std::mt19937_64& random);

/// Visits of no length at the given times, ascending.
/// @param wrong  Probability that a visit shows another state than the true one, all alike; the
///               evidence says exactly that. 0 < wrong < 1.
ChainHistory ObservePath(const ChainPath& path,
                         int states,
                         const std::vector<Stamp>& stamps,
                         double wrong,
                         std::mt19937_64& random);

}  // namespace shiftmap
