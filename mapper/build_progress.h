// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <mutex>
#include <string>

#include "mapper/state/build_state.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Where a build is.
struct MapperProgress {
  std::string phase;  ///< What it does now.
  double done = 0.0;  ///< Of the whole build, in [0, 1].
  double cost = 0.0;  ///< Half the sum of all losses at the last solve of what the phase is about.
  std::size_t modes = 0;  ///< That it has by now.
};

/// Called as a build goes on, at least before every solve; false asks it to stop. One call at a
/// time, from any of the threads of the build.
using MapperMonitor = std::function<bool(const MapperProgress&)>;

/// Runs by themselves take about half of a build.
inline constexpr double kSingleRunsShare = 0.5;

/// Tells the monitor of a build how it goes on, one thread at a time, and remembers that it asked
/// to stop.
class BuildWatch {
 public:
  /// @param monitor  Has to outlive the watch.
  explicit BuildWatch(const MapperMonitor& monitor) : monitor_(monitor) {}

  /// Returns whether to go on.
  bool Report(const std::string& phase, double done, const BuildState& build);

  /// Reports the steps of a phase that begins when this share of the build is done.
  StepCallback During(std::string phase, double done);

  /// kCancelled once the monitor asked to stop.
  Status status() const;

 private:
  const MapperMonitor& monitor_;
  mutable std::mutex mutex_;
  double done_ = 0.0;
  bool stopped_ = false;
};

}  // namespace shiftmap
