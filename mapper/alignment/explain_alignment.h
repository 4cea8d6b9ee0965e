// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/explanation_search.h"
#include "mapper/alignment/move_prior.h"

namespace shiftmap {

/// A set of groups that stayed.
struct StayedSet {
  std::vector<int> groups;   ///< Ascending.
  double probability = 0.0;  ///< Given the frame.
};

/// Sets of groups by falling probability.
std::vector<StayedSet> ByFallingProbability(const std::map<std::vector<int>, double>& sets);

/// One frame that the other map may have in the reference, and the most likely set of landmarks
/// that stayed in it.
struct Explanation {
  Alignment alignment;        ///< Its signatures are those that stayed; none: fewer than two did.
  std::vector<Match> stayed;  ///< What stayed where.
  std::vector<int> moved;     ///< Groups of which nothing stayed, ascending.
  std::vector<int>
      together;  ///< Of these, those of the likeliest body, if one is likelier than none.
  double probability = 0.0;  ///< Of the frame, over all sets of landmarks that lead to it.

  /// The sets that lead to it, by falling probability, those below 0.01 left out.
  std::vector<StayedSet> alternatives;

  /// Per group in common, ascending, the probability that it stayed, given the frame.
  std::vector<std::pair<int, double>> stays;

  bool nothing_stayed() const { return alignment.signatures.empty(); }
};

struct Explanations {
  std::vector<Explanation> frames;  ///< By falling probability; they add up to one, but for 1e-6.

  /// Groups that stayed in one of the two most likely frames and moved in the other: another run
  /// past them decides.
  std::vector<int> deciding;

  double nothing_stayed = 0.0;  ///< Probability that fewer than two landmarks stayed.
};

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
