// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapper/chain/chain_history.h"
#include "mapstore/core/stamp.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What the system itself made of a record.
struct ReplayedRecord {
  double nats_per_hour = 0.0;  ///< Log-likelihood of the held-out visits.
  double leave_per_day = 0.0;  ///< Mean over the states, with its interval.
  double low_per_day = 0.0;
  double high_per_day = 0.0;
  Duration rhythm{0};  ///< Period of the chain's rhythm; 0 without one.

  /// Whether the chain that the store has is, bit by bit, learned from its rows again.
  bool recomputed = false;
};

/// Replays a record as the visits of a landmark, its first state for `absent`, through a map store:
/// a report of rows for each day, the fit of a night over the ledger, a version with what was
/// learned, and LoadAt just before each visit after that. The store is in a temporary folder.
/// @param train, test  Visits without length; the first one of `test` is known.
StatusOr<ReplayedRecord> ReplayRecord(const ChainHistory& train, const ChainHistory& test);

}  // namespace shiftmap
