// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <map>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Modes of one landmark in a survey at most. A chain's matrix takes n² numbers (8 MB at 1000) and
/// its exponential n³ operations; a landmark known at more places than this is a moving one.
inline constexpr std::size_t kMaxSurveyModes = 1000;

/// One landmark of a survey, whatever file it is from.
struct SurveyGroup {
  struct Row {
    Mode mode;
    double probability = 0.0;
  };
  std::map<ModeNumber, Row> rows;  ///< By mode; that of kAbsent has a probability only.
  double leave_rate_per_s = 0.0;   ///< Of the group's chain. [1/s]

  /// Errors: kInvalidArgument if the mode is given twice, or there are more than kMaxSurveyModes.
  Status Add(const Row& row);
};

/// A map of surveyed landmarks. What a group's probabilities lack of 1 is that of `absent`.
/// Positions of different modes are taken as independent. The calibration is the default one.
/// @param stamp  When the probabilities hold.
/// @param anonymous_landmarks  Those without a signature.
/// Errors: kInvalidArgument, naming the landmark, for one without a mode, probabilities that sum to
/// more than 1, or as ValidateMapContent().
StatusOr<MapContent> MakeSurveyMap(const std::map<Signature, SurveyGroup>& groups,
                                   Stamp stamp,
                                   std::vector<Mode> anonymous_landmarks = {});

/// Reads surveyed landmarks: CSV with the header
///
///   signature,mode,x_m,y_m,sd_x_m,sd_y_m,probability
///
/// and a row per mode, in any order; mode 0 gives the probability of `absent` and leaves the
/// position empty. Signatures are cells of text (mapstore/core/csv.h).
/// @param stamp             When the probabilities hold.
/// @param leave_rate_per_s  Of every group's chain. [1/s]
/// Errors: kNotFound, kUnavailable; kInvalidArgument with `<path>:<line>` for a malformed row, a
/// mode given twice or more than kMaxSurveyModes; as MakeSurveyMap().
StatusOr<MapContent> ReadSurvey(const std::string& path, Stamp stamp, double leave_rate_per_s);

}  // namespace shiftmap
