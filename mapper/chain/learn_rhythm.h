// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapper/chain/learn_chain.h"
#include "mapstore/map/chain_rhythm.h"
#include "mapstore/map/mode_chain.h"
#include "proto/core/status.h"

namespace shiftmap {

struct RhythmOptions {
  /// Jumps that what a phase's rates are drawn to counts, per rate; > 0.
  double weight = 1.0;

  /// Share of the visits, the last ones, that decides; in (0, 1).
  double held_out = 0.3;

  /// Of MakeChainSteps; >= 0.
  double gap_resolution = 0.0;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// Whether rates that depend on the hour predict better, and which.
struct LearnedRhythm {
  std::optional<ChainRhythm> rhythm;

  /// Log-likelihood of the held-out visits, with the rhythm, or that of the day if none is taken,
  /// minus without; 0 if there are too few visits to tell. [nat]
  double held_out_gain = 0.0;
};

/// The rates of each phase by EM, drawn to others: q_h ~ Gamma(weight, weight / q).
/// @param toward  One chain per phase.
std::vector<ModeChain> FitPhases(const ChainHistory& history,
                                 const RhythmCalendar& calendar,
                                 const std::vector<ModeChain>& toward,
                                 const RhythmOptions& options);

/// Learns the rates of the hours of the day, drawn to those of all hours, and of the hours of the
/// week, drawn to those of the day, from the first visits. Takes the one that predicts the last
/// visits best, each from all before it, if it gains enough, and learns it from all visits.
///
/// Nothing is taken of a history whose first part is shorter than three periods, or whose last part
/// is shorter than one.
/// @param whole     The fit to the same history.
/// @param learning  How it was learned: with its structure, and with the prior that it had.
/// Errors: as LearnChain and Validate.
StatusOr<LearnedRhythm> LearnRhythm(const ChainHistory& history,
                                    const RateFit& whole,
                                    const ChainLearningOptions& learning,
                                    const RhythmOptions& options);

}  // namespace shiftmap
