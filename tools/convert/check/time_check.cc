// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/check/time_check.h"

#include <fmt/format.h>

#include <algorithm>

#include "mapstore/core/median.h"

namespace shiftmap {
namespace {

constexpr double kMinGapS = 1.0;
constexpr double kGapIntervals = 10.0;
constexpr double kClockJumpS = 3600.0;

}  // namespace

void TimeCheck::Add(Stamp stamp) {
  if (count_++ == 0) {
    begin_ = end_ = last_ = stamp;
    return;
  }
  const Duration interval = stamp - last_;
  if (interval < Duration(0)) {
    if (steps_back_++ == 0) first_step_back_ = stamp;
    worst_step_back_ = std::max(worst_step_back_, -interval);
  } else {
    if (intervals_s_.size() < kMaxIntervals) {
      intervals_s_.push_back(static_cast<float>(ToSeconds(interval)));
    }
    if (interval > longest_) {
      longest_ = interval;
      longest_from_ = last_;
    }
  }
  begin_ = std::min(begin_, stamp);
  end_ = std::max(end_, stamp);
  last_ = stamp;
}

std::optional<double> TimeCheck::MedianInterval() const {
  if (intervals_s_.empty()) return std::nullopt;
  return static_cast<double>(Median(intervals_s_));
}

void TimeCheck::Report(Stamp begin, Findings* findings) const {
  if (steps_back_ > 0) {
    findings->push_back(
        {Severity::kError,
         "out_of_order",
         fmt::format("{}, {}", kind_, TimeInRun(first_step_back_, begin)),
         fmt::format("{} of {} stamps are before the one before, by up to {:.6f} s",
                     steps_back_,
                     count_,
                     ToSeconds(worst_step_back_)),
         "stamp where the data is measured, and write the log in the order of stamps"});
  }
  const double median_s = MedianInterval().value_or(0.0);
  const double longest_s = LongestInterval();
  if (longest_s <= std::max(kMinGapS, kGapIntervals * median_s)) return;
  const bool jump = longest_s > kClockJumpS;
  findings->push_back(
      {Severity::kWarning,
       jump ? "clock_jump" : "gap",
       fmt::format("{}, {}", kind_, TimeInRun(longest_from_, begin)),
       fmt::format("nothing for {:.1f} s, usual are {:.3f} s", longest_s, median_s),
       jump ? "the clock was set, or two runs are in one log: begin a log for each"
       : kind_ == "scans"
           ? "log scans that saw nothing too; if the detector stopped, see why"
           : "see whether the recorder or the driver stopped; the pose is a guess there"});
}

}  // namespace shiftmap
