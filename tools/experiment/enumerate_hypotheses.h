// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/explanation_search.h"

namespace shiftmap {

/// All sets of two and more landmarks that stayed, each with all pairs of bodies of the others:
/// what SearchHypotheses() is measured by. That fewer than two stayed is taken from there. Sets and
/// bodies that are less likely by 30 nats than others are left out. Time grows as 2^landmarks.
///
/// Precondition: at most 20 landmarks, each of one mode.
std::vector<Hypothesis> EnumerateHypotheses(const AlignmentEvidence& evidence);

}  // namespace shiftmap
