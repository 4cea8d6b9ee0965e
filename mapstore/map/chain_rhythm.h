// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/rhythm_calendar.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Rates of a mode chain that depend on the hour of the day, or of the week: a rate matrix for each
/// part of the calendar.
///
/// Threads: const-safe.
class ChainRhythm {
 public:
  /// Parts of a calendar at most: the hours of a week.
  static constexpr int kMaxPhases = 168;

  /// @param rate_matrices  One per phase, all of one size, rows = from; as ModeChain::FromRates
  ///                       takes them. [1/s]
  /// Errors: kInvalidArgument, naming the phase.
  static StatusOr<ChainRhythm> Make(Duration period, std::vector<Eigen::MatrixXd> rate_matrices);

  const RhythmCalendar& calendar() const { return calendar_; }
  const std::vector<Eigen::MatrixXd>& rate_matrices() const { return rate_matrices_; }
  int states() const { return static_cast<int>(rate_matrices_.front().rows()); }

  /// Π from one time to another, row-stochastic; the identity if that is not later. By
  /// uniformization, all terms of which are positive, over the parts in between; whole periods by
  /// squaring.
  Eigen::MatrixXd Transition(Stamp from, Stamp to) const;

  bool operator==(const ChainRhythm& other) const {
    return calendar_.period == other.calendar_.period && rate_matrices_ == other.rate_matrices_;
  }

 private:
  ChainRhythm(Duration period, std::vector<Eigen::MatrixXd> rate_matrices);

  // Moves distributions, the rows, forward through the parts.
  void Advance(Stamp from, Duration elapsed, Eigen::MatrixXd* rows) const;
  void AdvanceIn(int phase, double seconds, Eigen::MatrixXd* rows) const;

  RhythmCalendar calendar_;
  std::vector<Eigen::MatrixXd> rate_matrices_;
};

}  // namespace shiftmap
