// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/displaced_landmarks.h"
#include "mapper/alignment/explanation.h"

namespace shiftmap {

/// The frames in which landmarks may have been displaced, each with its probability. Two ways are
/// of one frame if what their landmarks have in common differs by less than `same_frame_m`.
///
/// Of Explanation::alignment there are signatures only, and Explanation::stayed is empty.
/// @param groups         Of the landmarks, ascending.
/// @param displacements  By falling probability.
Explanations ExplainDisplacements(const IndexedVector<LandmarkIndex, GroupIndex>& groups,
                                  const std::vector<Displacement>& displacements,
                                  double same_frame_m);

}  // namespace shiftmap
