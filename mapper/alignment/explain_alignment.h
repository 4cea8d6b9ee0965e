// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/explanation.h"
#include "mapper/alignment/explanation_search.h"
#include "mapper/alignment/move_prior.h"

namespace shiftmap {

/// The frames of hypotheses, which have probabilities.
Explanations SumToExplanations(const AlignmentEvidence& evidence,
                               const std::vector<Hypothesis>& hypotheses,
                               const ExplanationLimits& limits);

/// Explains the difference of two maps of one place, where landmarks may have moved in between:
/// which frames the other map may have in the reference, each with its probability
/// (mapper/METHOD.md, 6). Both covariances must be honest: with one four times too small, two in a
/// hundred of what has a probability of 0.99 are wrong.
///
/// Nothing is returned for more than kMaxMatches pairs of modes of one group, or fewer than two
/// landmarks in common. Deterministic; probabilities depend on the frames of the maps and on the
/// order of points by less than 0.01, which random draws leave.
/// @param area_m2  That the reference takes. [m²]
std::optional<Explanations> Explain(const JointPoints& reference,
                                    const JointPoints& other,
                                    double area_m2,
                                    const MovePrior& prior,
                                    const ExplanationLimits& limits);

}  // namespace shiftmap
