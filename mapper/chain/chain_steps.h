// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/rhythm_calendar.h"

namespace shiftmap {

/// A history as the recursions over it read it: steps with time between them. The clock of the
/// chain stands still inside a visit, as it does in the filters (Π = I there).
struct ChainSteps {
  /// Time that passes in one phase of the calendar.
  struct Gap {
    Duration length{0};
    int phase = 0;
  };

  int states = 1;
  int phases = 1;
  std::vector<Gap> gaps;         ///< The different ones; work goes with their number.
  std::vector<int> gap_of_step;  ///< Index of the gap before each step; -1 before the first.
  Eigen::MatrixXd likelihoods;   ///< states x steps; the largest of each column is 1.
  double log_scale = 0.0;        ///< Sum of the logarithms of what the columns were divided by.
};

/// @param history     Passes CheckHistory.
/// @param calendar    A gap that reaches over several of its phases becomes several, with steps
///                    between them at which nothing is seen.
/// @param gap_resolution  Gaps that differ by less than about this factor less 1 share their mean
///                    length, so that years of irregular visits have a few hundred gaps; 0: exact.
ChainSteps MakeChainSteps(const ChainHistory& history,
                          const RhythmCalendar& calendar = {},
                          double gap_resolution = 0.0);

}  // namespace shiftmap
