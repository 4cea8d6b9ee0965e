// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/alignment_evidence.h"

namespace shiftmap {

/// log of the density of all positions if every landmark moved, some of them near where they were:
///
///   ∫ p(x) (Π p(d | moved, x) - Π p(d | moved anywhere)) dx
///
/// over rigid transforms x, uniform over the area and all headings. By importance sampling from
/// Gaussians around where most moved little, which are sought from `starts`; without one that is
/// minus infinity. Deterministic.
double LogAllMovedSomeNear(const AlignmentEvidence& evidence,
                           const std::vector<SimilarityFit>& starts);

}  // namespace shiftmap
