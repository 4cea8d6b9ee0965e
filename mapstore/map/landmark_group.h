// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/map/mode.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// A mode that was found to be the same position as another one.
struct MergedMode {
  ModeNumber number;  ///< Retired: no mode gets it again.
  ModeNumber into;    ///< The mode of the group that stands for it now; kAbsent of one that a
                      ///< person added and took back: there the landmark is at no known position.
};

/// Every known position of one physical landmark, and the chain it jumps by.
struct LandmarkGroup {
  Signature signature;
  std::vector<Mode> modes;                       ///< By ascending number.
  ModeChain chain = ModeChain::Uniform(0, 0.0);  ///< modes.size() + 1 states.

  std::vector<MergedMode> merged;  ///< Of this version and its ancestors, by ascending number.

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

  /// As StateOf, but a merged mode has the state of the mode that stands for it now.
  int CarriedStateOf(ModeNumber number) const {
    for (const MergedMode& mode : merged) {
      if (mode.number == number) return StateOf(mode.into);
    }
    return StateOf(number);
  }

  /// The number after all that were ever given to a mode of this landmark.
  ModeNumber NextNumber() const {
    ModeNumber last = kAbsent;
    if (!modes.empty()) last = modes.back().number;
    if (!merged.empty() && last < merged.back().number) last = merged.back().number;
    return ModeNumber(last.value() + 1);
  }

  /// The mode number of a state index in 0..n.
  ModeNumber NumberOf(int state) const {
    return state == 0 ? kAbsent : modes[static_cast<std::size_t>(state) - 1].number;
  }
};

}  // namespace shiftmap
