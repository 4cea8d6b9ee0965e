// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <optional>

#include "localizer/live/messages.h"
#include "mapstore/core/stamp.h"

namespace shiftmap::live {

/// Judges whether the stamps of items still lie on the time line of the shift.
///
/// One item off the time line is a bad stamp. Nothing but such items for a while is a clock that
/// was set. Time is that of a steady clock; no timer runs, since a pause of the stream says
/// nothing.
class TimeLineWatch {
 public:
  using Clock = std::chrono::steady_clock;

  /// @param patience  For how long every item must have been refused, >= 0.
  explicit TimeLineWatch(Duration patience) : patience_(patience) {}

  /// An item was on the time line.
  void Accepted(Clock::time_point now);

  /// An item was refused for its stamp.
  /// @param why  kLate or kFuture.
  void Refused(TimeLine why, Clock::time_point now);

  /// kLate: nothing but late items came for a while; kFuture: items were ahead of the host's clock,
  /// or some of both came.
  TimeLine verdict() const { return verdict_; }

  /// Since the last item that was accepted; 0 before the first.
  Duration SinceAccepted(Clock::time_point now) const;

 private:
  Duration patience_;
  std::optional<Clock::time_point> accepted_;
  std::optional<Clock::time_point> refused_since_;  // The first of those after it.
  std::optional<Clock::time_point> late_since_;  // The first of those that only late ones follow.
  TimeLine verdict_ = TimeLine::kAgrees;
};

}  // namespace shiftmap::live
