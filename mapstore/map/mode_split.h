// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapstore/map/evidence.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/mode_filter.h"

namespace shiftmap {

/// A mode that a person found to be two places.
struct ModeSplit {
  ModeNumber mode;    ///< It is the first place now,
  ModeNumber second;  ///< and this mode the second one.

  /// Runs (RunRecord::identity) that met the landmark at the first place, and at the second.
  std::vector<std::string> first_runs;
  std::vector<std::string> second_runs;
};

/// Adds to a visit what it tells of the second place, if it was made before the split. What it
/// tells of the mode counts for both places. Of a run that is known to have met the landmark at one
/// of them, the other one is no more likely than `absent`.
/// @param group  Of the map that the visit is read for, with the modes' numbers.
/// @param run    Whose visit it is.
/// @param modes  `absent` first, by ascending number.
void SplitEvidence(const LandmarkGroup& group,
                   const ModeSplit& split,
                   const std::string& run,
                   std::vector<VisitEvidence::ModeLogLikelihood>* modes);

/// What was stated before a split: each place has half of the mode's probability.
/// @param stated  `absent` first.
std::vector<StatedMode> SplitStatement(const LandmarkGroup& group,
                                       const ModeSplit& split,
                                       std::vector<StatedMode> stated);

}  // namespace shiftmap
