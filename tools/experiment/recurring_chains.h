// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "mapper/chain/learn_chain.h"
#include "mapstore/map/mode_chain.h"
#include "proto/core/status.h"
#include "tools/experiment/recurring_data.h"

namespace shiftmap {

/// Mode chains learned from real things that jump between states, tested on what came later.
struct RecurringChainsOptions {
  std::uint64_t seed = 1;
  double train_share = 2.0 / 3.0;  ///< Of the record's minutes, the first ones.

  /// Visits that are learned from.
  std::vector<VisitSpacing> train = {
      {"1 min", 60.0}, {"10 min", 600.0}, {"1 h", 3600.0}, {"6 h", 21600.0}, {"random", 0.0}};

  /// Visits that are predicted, each from all before.
  std::vector<VisitSpacing> test = {{"1 min", 60.0}, {"1 h", 3600.0}};

  double hand_set_change = 1e-4;  ///< Per observation of a minute, IJRR 8.2.2.
  ChainLearningOptions learning;
};

/// One way to have a chain, at one spacing of the training visits.
struct RecurringChainsRow {
  std::string record;
  std::string train;
  std::string test;
  std::string method;
  double nats_per_hour = 0.0;  ///< Held-out log-likelihood.
  double leave_per_day = 0.0;  ///< Mean over the states; NaN where there is no rate.
  double low_per_day = 0.0;    ///< Interval of it; NaN where there is none.
  double high_per_day = 0.0;
  double train_visits = 0.0;

  /// Period of the rhythm that the held-out part of the training visits spoke for; 0: for none.
  double rhythm_hours = 0.0;
};

/// Rows by record, training and test spacing, method:
///   hand-set     ModeChain::Uniform at the hand-set change,
///   frequency    no chain: the share of training visits in each state,
///   jump count   jumps between successive visits by the time spent, as if none were missed,
///   uniform      LearnChain, one leave rate,
///   general      LearnChain, all rates,
///   rhythm       LearnRhythm on the general structure,
///   rhythm, late  the same with everything an hour later, as where clocks went to winter time,
///   product      ReplayRecord, of training visits every minute or hour and tests every hour,
///   truth        the chain itself, for a simulated record.
StatusOr<std::vector<RecurringChainsRow>> CompareChains(
    const RecurringRecord& record,
    const ModeChain* truth,
    const RecurringChainsOptions& options,
    const std::function<void(double)>& progress);

/// A record of the same times as `like`, drawn from a chain; named "simulated <name>".
RecurringRecord SimulateRecord(const RecurringRecord& like,
                               const ModeChain& chain,
                               std::uint64_t seed);

}  // namespace shiftmap
