// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "localizer/localizer_options.h"
#include "localizer/localizer_state.h"
#include "tools/experiment/localizer_states_world.h"

namespace shiftmap {

/// What the localizer said of one shift after its cause set in.
struct ReportedShift {
  std::array<double, kLocalizerStates> first_s = {};  ///< By state, after the cause; -1: never. [s]
  bool said_before = false;                           ///< LOST or UNKNOWN_CHANGE before the cause.
  bool duplicate_alarm = false;

  /// LOST was said, and each time the pose was outside of 0.999 of the distribution that it stated.
  bool lost_rightly = false;
  LocalizerState last = LocalizerState::kInitializing;
  double error_m = 0.0;  ///< Of the last pose. [m]

  bool Said(LocalizerState state) const { return first_s[static_cast<std::size_t>(state)] >= 0.0; }

  /// LOST against UNKNOWN_CHANGE: a failing pose must not count as a change of the map, nor the
  /// reverse; a pose that recovers, or a change that is never seen, may go without either.
  bool Confused(ShiftCause cause) const;
};

/// Columns of the matrix.
inline constexpr std::size_t kReportColumns = 6;
const char* ReportColumn(std::size_t column);

/// The column of a shift: the worst that was said, LOST before UNKNOWN_CHANGE before
/// DUPLICATE_SIGNATURE before MODE_CHANGED. Where both of the first two were said, the wrong one.
std::size_t ColumnOf(const ReportedShift& reported, ShiftCause cause);

ReportedShift LocalizeShift(const CausedShift& shift, const LocalizerOptions& options);

/// All shifts of one cause.
struct CauseTally {
  ShiftCause cause = ShiftCause::kNothing;
  std::int64_t shifts = 0;
  std::array<std::int64_t, kReportColumns> reported = {};
  std::int64_t confused = 0;
  std::int64_t pose_wrong = 0;  ///< Of the confused: the pose was indeed wrong when it was LOST.
  std::int64_t said_before = 0;
  std::int64_t recovered = 0;  ///< Ends neither LOST nor INITIALIZING, half a metre right.
  double delay_s = 0.0;        ///< Mean, to LOST or UNKNOWN_CHANGE, where it was said. [s]
  std::vector<std::uint64_t> confused_seeds;
};

/// Shifts with the seeds `first_seed`, `first_seed` + 1, … of one cause.
/// Determinism: independent of the number of threads.
CauseTally TallyCause(ShiftCause cause,
                      std::uint64_t first_seed,
                      int shifts,
                      int threads,
                      const LocalizerOptions& options);

}  // namespace shiftmap
