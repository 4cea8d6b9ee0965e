// SPDX-License-Identifier: Apache-2.0
#include "mapper/build_progress.h"

#include <algorithm>
#include <utility>

namespace shiftmap {

bool BuildWatch::Report(const std::string& phase, double done, const BuildState& build) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!monitor_ || stopped_) return !stopped_;
  std::size_t modes = 0;
  for (const GroupModes& group : build.modes) modes += group.size();
  done_ = std::max(done_, done);  // Threads take runs in turn, not their reports.
  stopped_ = !monitor_({phase, done_, build.cost, modes});
  return !stopped_;
}

StepCallback BuildWatch::During(std::string phase, double done) {
  return [this, phase = std::move(phase), done](const BuildState& build) {
    return Report(phase, done, build);
  };
}

Status BuildWatch::status() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return stopped_ ? MakeStatus(StatusCode::kCancelled, "build: stopped") : OkStatus();
}

}  // namespace shiftmap
