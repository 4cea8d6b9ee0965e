// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/rhythm_calendar.h"

namespace shiftmap {

/// A history as the recursions over it read it: steps with time between them. The clock of the
/// chain stands still inside a visit, as it does in the filters (Π = I there).
struct ChainSteps {
  /// Time that passes in one phase of the calendar, or in several whole ones.
  struct Gap {
    Duration length{0};
    int phase = 0;  ///< Of several, the first.

    /// Of several phases: the two gaps that follow each other in it, each before it in `gaps`.
    int first = -1;
    int second = -1;

    bool composed() const { return first >= 0; }
  };

  /// The step at which a visit is seen.
  struct Visit {
    int step = 0;
    double log_scale = 0.0;  ///< Logarithm of the divisor of the step's column.
  };

  int states = 1;
  int phases = 1;
  std::vector<Gap> gaps;         ///< The different ones; work goes with their number.
  std::vector<int> gap_of_step;  ///< Index of the gap before each step; -1 before the first.
  Eigen::MatrixXd likelihoods;   ///< states x steps; the largest of each column is 1.
  std::vector<Visit> visits;
  double log_scale = 0.0;  ///< Sum over the visits.
};

/// @param history     Passes CheckHistory.
/// @param calendar    A gap that reaches over several of its phases becomes several, with steps
///                    between them at which nothing is seen. Of n whole phases in a row these are
///                    about log n, aligned to powers of two, which most gaps share.
/// @param gap_resolution  Gaps that differ by less than about this factor less 1 share their mean
///                    length, so that years of irregular visits have a few hundred gaps; 0: exact.
ChainSteps MakeChainSteps(const ChainHistory& history,
                          const RhythmCalendar& calendar = {},
                          double gap_resolution = 0.0);

/// The steps of the first `visits` visits, 1 or more, with gaps of the same lengths.
ChainSteps FirstVisits(const ChainSteps& steps, std::size_t visits);

}  // namespace shiftmap
