// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapstore/map/landmark_group.h"
#include "mapstore/map/mode_filter.h"

namespace shiftmap {

/// Probability that each row is part of a mistaken turn (AddVisit): by what the next vehicle saw of
/// the landmark, or, of the last turn about one, by the turn and its vehicle's record. All groups
/// are filtered in one pass in the order of time.
/// @param groups  By signature.
/// @param rows    Of any landmarks, in any order, each once; 0 for rows of others, and for those
///                that favour a mode that the group does not have.
/// Returns one per row, which does not depend on the order of rows.
std::vector<double> MistakeProbabilities(const std::vector<LandmarkGroup>& groups,
                                         const std::vector<EvidenceRow>& rows);

}  // namespace shiftmap
