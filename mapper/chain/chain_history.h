// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/mode_filter.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What one visit says about the state of a chain, which is the same throughout the visit.
struct ChainVisit {
  Stamp begin;
  Stamp end;
  Eigen::VectorXd log_likelihoods;  ///< Per state, up to a constant of the visit. [nat]
};

/// A prior of the leave rate: a number of jumps, and the time in which they were seen.
struct StatedRate {
  double jumps = 0.0;    ///< >= 0.
  double seconds = 0.0;  ///< > 0 where there are jumps. [s]
};

/// All that was seen of one group's chain.
struct ChainHistory {
  Signature signature;
  int states = 1;  ///< `absent` and the modes.

  /// By time. A visit begins after the end of the one before.
  std::vector<ChainVisit> visits;

  StatedRate stated = {};  ///< Counts like further visits.
};

/// The ledger's rows of a group as a history.
///
/// Rows that favour a mode that the group does not have are left out, one given twice counts once
/// (FilterModes does the same). Visits that overlap or touch are one visit with the sum of their
/// evidence: no time passes between them.
/// @param rows  Of the group's landmark, in any order.
ChainHistory MakeChainHistory(const LandmarkGroup& group, std::vector<EvidenceRow> rows);

/// The same history if a share of visits is about something else, and says nothing of the state:
///
///     p(seen | k) <- (1 - share) p(seen | k) / Σ_i p(seen | i) + share / states
///
/// @param share  In [0, 1).
ChainHistory AllowMistakes(ChainHistory history, double share);

/// The first `visits` visits.
ChainHistory FirstVisits(const ChainHistory& history, std::size_t visits);

/// Errors: kInvalidArgument naming the first visit out of order, of another size, or with a value
/// that is not finite.
Status CheckHistory(const ChainHistory& history);

}  // namespace shiftmap
