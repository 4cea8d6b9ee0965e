// SPDX-License-Identifier: Apache-2.0
#include "mapper/state/undecided_runs.h"

#include <fmt/format.h>

namespace shiftmap {

std::string ReasonsOf(const std::vector<RejectedRun>& rejected) {
  constexpr int kMost = 20;
  std::string reasons;
  int count = 0;
  for (const RejectedRun& run : rejected) {
    if (run.is_mapped || ++count > kMost) continue;
    if (count > 1) reasons += "; ";
    reasons += fmt::format("run '{}': {}", run.name, run.reason);
  }
  if (count > kMost) reasons += fmt::format("; {} more", count - kMost);
  return reasons;
}

Status RequireRuns(bool any, const std::vector<RejectedRun>& rejected) {
  if (any) return OkStatus();
  if (rejected.empty()) return InvalidArgument("no runs to build from");
  return InvalidArgument("no run can be used: {}", ReasonsOf(rejected));
}

}  // namespace shiftmap
