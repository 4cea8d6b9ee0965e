// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <utility>
#include <vector>

#include "mapper/alignment/alignment_evidence.h"
#include "mapper/alignment/consensus.h"

namespace shiftmap {

/// Explanations and sets that are less likely are not told.
inline constexpr double kUnlikely = 0.01;

/// A set of groups that stayed.
struct StayedSet {
  std::vector<GroupIndex> groups;  ///< Ascending.
  double probability = 0.0;        ///< Given the frame.
};

/// Which groups stayed, given a frame.
struct StayedPosterior {
  /// By falling probability, those below kUnlikely left out.
  std::vector<StayedSet> alternatives;

  /// Per group in common, ascending, the probability that it stayed.
  std::vector<std::pair<GroupIndex, double>> stays;
};

/// One frame that the other map may have in the reference, and the most likely set of landmarks
/// that stayed in it.
struct Explanation {
  Alignment alignment;        ///< Its signatures are those that stayed; none: fewer than two did.
  std::vector<Match> stayed;  ///< What stayed where.
  std::vector<GroupIndex> moved;  ///< Groups of which nothing stayed, ascending.
  double probability = 0.0;       ///< Of the frame, over all sets of landmarks that lead to it.

  StayedPosterior given;  ///< Over the sets that lead to it.

  bool nothing_stayed() const { return alignment.signatures.empty(); }
};

struct Explanations {
  std::vector<Explanation> frames;  ///< By falling probability; they add up to one, but for 1e-6.

  const Explanation& best() const { return frames.front(); }

  /// Groups that stayed in one of the two most likely frames and moved in the other: another run
  /// past them decides.
  std::vector<GroupIndex> deciding;
};

/// Sets of groups that stayed, ascending, with their probabilities.
using StayedSets = std::map<std::vector<GroupIndex>, double>;

std::vector<StayedSet> ByFallingProbability(const StayedSets& sets);

/// One frame but for its transform and what stayed where.
/// @param sets       That lead to it.
/// @param likeliest  Of these.
/// @param groups     In common, in any order, each once or more.
Explanation DescribeFrame(const StayedSets& sets,
                          const std::vector<GroupIndex>& likeliest,
                          const std::vector<GroupIndex>& groups);

/// The sets that lead to a frame, each as one of its own.
Explanations BySets(const Explanation& frame);

/// Sorts frames by falling probability, and finds the groups that decide between the first two.
Explanations DescribeFrames(std::vector<Explanation> frames);

}  // namespace shiftmap
