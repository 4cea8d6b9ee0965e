// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "localizer/monitor/scan_consistency.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

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
