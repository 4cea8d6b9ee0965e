// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/alignment/alignment_evidence.h"

namespace shiftmap {

/// When explanations count as different.
struct ExplanationLimits {
  /// Transforms that place all landmarks this alike are one frame. [m]
  double same_frame_m = 0.4;
};

/// A set of landmarks that stayed, or that fewer than two did.
struct Hypothesis {
  MatchSet stayed;  ///< Empty: fewer than two stayed, and there is no transform.
  SimilarityFit fit;
  double log_score = 0.0;
  double probability = 0.0;
};

/// Makes probabilities of the scores, and sorts by them.
void NormalizeAndSort(std::vector<Hypothesis>* hypotheses);

/// Searches the sets of matches that explain two maps, best first (mapper/METHOD.md, 6):
/// from each pair of matches whose distances agree by single changes to a maximum of the score,
/// then from the maxima outward through all sets within the window. Deterministic.
///
/// Precondition: kMaxMatches matches at most.
std::vector<Hypothesis> SearchHypotheses(const AlignmentEvidence& evidence);

}  // namespace shiftmap
