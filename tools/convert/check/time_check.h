// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/stamp.h"
#include "tools/convert/check/finding.h"

namespace shiftmap {

/// The stamps of one kind of items, in the order in which the log has them: rate, gaps, steps back.
class TimeCheck {
 public:
  /// @param kind  "odometry" or "scans".
  explicit TimeCheck(std::string kind) : kind_(std::move(kind)) {}

  void Add(Stamp stamp);

  /// @param begin  Of the run, for places.
  void Report(Stamp begin, Findings* findings) const;

  std::int64_t count() const { return count_; }
  /// Least and greatest stamp. Precondition: count() > 0.
  Stamp begin() const { return begin_; }
  Stamp end() const { return end_; }

  /// Of the intervals between stamps; nothing with fewer than two. [s]
  std::optional<double> MedianInterval() const;

  /// The longest interval, 0 if there is none. [s]
  double LongestInterval() const { return ToSeconds(longest_); }

 private:
  /// Longer logs are judged by the intervals of their begin.
  static constexpr std::size_t kMaxIntervals = 1'000'000;

  std::string kind_;
  std::int64_t count_ = 0;
  Stamp begin_;
  Stamp end_;
  Stamp last_;
  Stamp longest_from_;
  Duration longest_{0};
  std::int64_t steps_back_ = 0;
  Duration worst_step_back_{0};
  Stamp first_step_back_;
  std::vector<float> intervals_s_;
};

}  // namespace shiftmap
