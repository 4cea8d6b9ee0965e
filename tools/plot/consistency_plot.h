// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "localizer/recording/shift_recording.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// The estimate after a scan, and how well the scan's observations fitted the one before them.
struct ScanConsistency {
  Stamp stamp;
  PoseWithCovariance pose;  ///< Covariance 0: not recorded.
  double nis = 0.0;      ///< Sum of νᵀ S⁻¹ ν over the observations that gated with a mode.
  std::int64_t dof = 0;  ///< Two per such observation.
};

/// By stamp; not empty if the recording has a pose.
std::vector<ScanConsistency> ScansOf(const ShiftRecording& recording);

/// Whether a localizer's covariances are right, as an SVG picture: the normalized innovation
/// squared per degree of freedom over time against its chi-square band, and a histogram of its
/// chi-square probabilities, which is flat for a consistent filter; with a truth, the normalized
/// estimation error squared of the pose over time as well.
/// @param name   Of the run, for the title.
/// @param scans  At least one.
/// @param truth  In the map frame.
std::string PlotConsistency(const std::string& name,
                            const std::vector<ScanConsistency>& scans,
                            const std::optional<std::vector<StampedPose>>& truth);

}  // namespace shiftmap
