// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

struct ScaleOptions {
  std::vector<int> key_frames = {1000, 3000, 10000};  ///< About as many in each site; ascending.
  int scans_per_run = 2000;
  int scans_per_group = 50;  ///< A site grows with its scans, up to max_groups landmarks.
  int max_groups = 5000;
  double misread_per_scan = 0.0;  ///< Observations that bear the signature of another landmark.
  double odometry_noise = 1.0;    ///< Times that of OpenWorldOptions.
  std::uint64_t seed = 1;
  int threads = 1;  ///< Of the builds.

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// One simulated site, built as a whole.
struct ScaleRow {
  int key_frames = 0;
  int runs = 0;
  int rejected = 0;           ///< Runs that tied to nothing.
  int groups = 0;             ///< In the map.
  int modes = 0;              ///< In the map.
  int true_modes = 0;         ///< Places at which a landmark stood in some run.
  int seen_modes = 0;         ///< Of those, with the sightings in one visit that a mode needs.
  double rms_m = 0.0;         ///< Of the modes' positions after rigid alignment with the truth.
  double median_m = 0.0;      ///< Of their distances from the truth.
  int far_modes = 0;          ///< A metre or more off.
  double nees = 0.0;          ///< Mean squared error of modes in standard deviations: 2 if right.
  double scale_error = 0.0;   ///< By how much the map is too large. [-]
  double nees_shape = 0.0;    ///< As nees, without that.
  double build_s = 0.0;       ///< Processor time of BuildMap, all threads.
  double wall_s = 0.0;        ///< Of BuildMap by the clock on the wall.
  double us_per_frame = 0.0;  ///< Processor time. [µs]
  double logs_mib = 0.0;      ///< Resident before the build: the program and the logs.
  double peak_mib = 0.0;      ///< Largest resident size of the process so far.
};

using ScaleProgress = std::function<void(double done)>;

/// Time and memory of a build over the size of the site, at a constant density of landmarks.
StatusOr<std::vector<ScaleRow>> RunScale(const ScaleOptions& options,
                                         const ScaleProgress& progress);

}  // namespace shiftmap
