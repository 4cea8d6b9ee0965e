// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "localizer/localizer.h"
#include "mapstore/map/evidence.h"

namespace shiftmap::live {

/// Counts what did not count, by reason. Reasons are a fixed set of words: memory is bounded.
class DropCounts {
 public:
  void Add(const std::string& reason, std::int64_t count = 1) { counts_[reason] += count; }

  /// Reasons in alphabetical order, those that never occurred left out.
  std::vector<DroppedCount> List() const;

 private:
  std::map<std::string, std::int64_t> counts_;
};

/// Adds the observations, samples and scans that the localizer itself set aside.
void AddDropped(const LocalizerStatistics& statistics, DropCounts* counts);

}  // namespace shiftmap::live
