// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/drop_counts.h"

namespace shiftmap::live {

std::vector<DroppedCount> DropCounts::List() const {
  std::vector<DroppedCount> list;
  for (const auto& [reason, count] : counts_) {
    if (count > 0) list.push_back({reason, count});
  }
  return list;
}

void AddDropped(const LocalizerStatistics& statistics, DropCounts* counts) {
  counts->Add("duplicate_signature", statistics.duplicate_signatures);
  counts->Add("unknown_signature", statistics.unknown_signatures);
  counts->Add("anonymous", statistics.anonymous);
  counts->Add("ungated", statistics.ungated);
  counts->Add("implausible_observation", statistics.implausible_observations);
  counts->Add("excess_observation", statistics.excess_observations);
  counts->Add("excess_place", statistics.excess_places);
  counts->Add("implausible_odometry", statistics.implausible_odometry);
  counts->Add("late", statistics.late);
  counts->Add("future", statistics.jumped);
}

}  // namespace shiftmap::live
