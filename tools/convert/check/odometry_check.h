// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>

#include "mapstore/run/item_limits.h"
#include "mapstore/run/run.h"
#include "tools/convert/check/finding.h"

namespace shiftmap {

/// Whether odometry moves, and in which units.
class OdometryCheck {
 public:
  explicit OdometryCheck(const ItemLimits& limits) : limits_(limits) {}

  void Add(const OdometrySample& sample);
  void Report(Stamp begin, Findings* findings) const;

  double max_speed_mps() const { return max_speed_mps_; }
  double max_yaw_rate_radps() const { return max_yaw_rate_radps_; }

 private:
  void ReportLimits(Stamp begin, Findings* findings) const;

  ItemLimits limits_;
  std::int64_t count_ = 0;
  std::int64_t moving_ = 0;
  std::int64_t fast_ = 0;      // Faster than what drives in halls and yards,
  std::int64_t spinning_ = 0;  // or turning faster.
  std::int64_t implausible_ = 0;
  std::optional<Stamp> first_implausible_;
  double max_speed_mps_ = 0.0;
  double max_yaw_rate_radps_ = 0.0;

  std::optional<OdometrySample> same_;  // The first of the samples that are equal to the last,
  Duration longest_same_{0};            // and the longest such stretch of a vehicle that moves.
  Stamp longest_same_from_;
};

}  // namespace shiftmap
