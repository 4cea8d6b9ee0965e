// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/time_line_watch.h"

namespace shiftmap::live {

void TimeLineWatch::Accepted(Clock::time_point now) {
  accepted_ = now;
  refused_since_.reset();
  late_since_.reset();
  verdict_ = TimeLine::kAgrees;
}

void TimeLineWatch::Refused(TimeLine why, Clock::time_point now) {
  if (why != TimeLine::kLate) {
    late_since_.reset();
  } else if (!late_since_) {
    late_since_ = now;
  }
  if (!refused_since_) refused_since_ = now;
  // One item alone is no evidence.
  const auto lasts = [&](const std::optional<Clock::time_point>& since) {
    return since && now > *since && now - *since >= patience_;
  };
  if (lasts(late_since_)) {
    verdict_ = TimeLine::kLate;
  } else if (lasts(refused_since_)) {
    verdict_ = TimeLine::kFuture;
  }
}

Duration TimeLineWatch::SinceAccepted(Clock::time_point now) const {
  return accepted_ ? Duration(now - *accepted_) : Duration::zero();
}

}  // namespace shiftmap::live
