// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Modes of one landmark in a survey at most. A chain's matrix takes n² numbers (8 MB at 1000) and
/// its exponential n³ operations; a landmark known at more places than this is a moving one.
inline constexpr std::size_t kMaxSurveyModes = 1000;

/// Reads surveyed landmarks: CSV with the header
///
///   signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability
///
/// and a row per mode, in any order; mode 0 gives the probability of `absent` and leaves the
/// position empty. What a group's probabilities lack of 1 is that of `absent`. Positions of
/// different modes are taken as independent. The calibration is the default one. Signatures are
/// cells of text (mapstore/core/csv.h).
/// @param stamp             When the probabilities hold.
/// @param leave_rate_per_s  Of every group's chain. [1/s]
/// Errors: kNotFound, kUnavailable; kInvalidArgument with `<path>:<line>` for a malformed row, a
/// mode given twice, more than kMaxSurveyModes, or probabilities that sum to more than 1.
StatusOr<MapContent> ReadSurvey(const std::string& path, Stamp stamp, double leave_rate_per_s);

}  // namespace shiftmap
