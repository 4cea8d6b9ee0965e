// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapper/chain/learn_chain.h"
#include "mapstore/map/mode_chain.h"
#include "proto/core/status.h"

namespace shiftmap {

struct DailyRhythmOptions {
  int phases = 24;        ///< Equal parts of the UTC day, each with rates of its own.
  double weight = 1.0;    ///< Jumps that the rates of the whole day count per phase and rate.
  double held_out = 0.3;  ///< Share of the visits, the last ones, that decides.
};

/// Rates that depend on the hour of the day, and whether they predict better.
struct DailyRhythm {
  bool taken = false;

  /// Log-likelihood of the held-out visits, with rhythm minus without. [nat]
  double held_out_gain = 0.0;

  /// One per phase of the day if taken, else one for all of it.
  std::vector<ModeChain> chains;
};

/// The rates of each phase by EM, drawn to those of the whole day: q_h ~ Gamma(weight, weight / q).
/// @param whole_day  The chain learned from the same history.
std::vector<ModeChain> FitDailyRates(const ChainHistory& history,
                                     const ModeChain& whole_day,
                                     const DailyRhythmOptions& options);

/// Learns with and without rhythm from the first visits, compares how both predict the last ones
/// given all before each, and learns the better one from all.
/// Errors: as LearnChain; kInvalidArgument for options out of range or fewer than two visits on
/// either side.
StatusOr<DailyRhythm> LearnDailyRhythm(const ChainHistory& history,
                                       const ChainLearningOptions& learning,
                                       const DailyRhythmOptions& options);

}  // namespace shiftmap
