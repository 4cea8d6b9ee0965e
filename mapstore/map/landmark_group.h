// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/mode.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// Every known position of one physical landmark, and the chain it jumps by.
struct LandmarkGroup {
  Signature signature;
  std::vector<Mode> modes;                       ///< By ascending number.
  ModeChain chain = ModeChain::Uniform(0, 0.0);  ///< modes.size() + 1 states.

  /// Mode probabilities, size modes.size() + 1: entry 0 is `absent`, entry i is modes[i - 1]; sums
  /// to 1. They hold at MapContent::stamp.
  Eigen::VectorXd probabilities = Eigen::VectorXd::Ones(1);

  /// The state index (1..n) of a mode number, 0 for kAbsent, -1 if there is no such mode.
  int StateOf(ModeNumber number) const {
    if (number == kAbsent) return 0;
    for (std::size_t i = 0; i < modes.size(); ++i) {
      if (modes[i].number == number) return static_cast<int>(i) + 1;
    }
    return -1;
  }

  /// The mode number of a state index in 0..n.
  ModeNumber NumberOf(int state) const {
    return state == 0 ? kAbsent : modes[static_cast<std::size_t>(state) - 1].number;
  }
};

}  // namespace shiftmap
