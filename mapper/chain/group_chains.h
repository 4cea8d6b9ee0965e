// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapper/chain/chain_history.h"
#include "mapper/chain/learn_chain.h"
#include "mapstore/map/landmark_group.h"
#include "mapstore/map/mode_filter.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How a map's chains are learned.
struct GroupChainOptions {
  /// What is usual before there is evidence: mean of the prior of a leave rate; > 0. [1/s]
  double leave_rate_per_s = 1e-5;

  /// Jumps that the prior counts as; > 0. More keep rates closer to what the groups have in common.
  double prior_jumps = 0.5;

  /// Share of visits whose evidence is about something else: a signature misread, a pose off. One
  /// such visit between others that agree is then no pair of jumps within minutes. In [0, 1).
  double mistaken_visits = 1e-3;

  /// What is stated about single landmarks.
  std::map<Signature, StatedRate> stated;

  /// Whether chains get a rhythm where held-out visits support it, and when they do.
  bool learn_rhythms = true;

  /// On which groups are fitted; the result does not depend on them.
  int threads = 1;

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

/// The chain of one group of a map.
struct GroupChain {
  LearnedChain chain;  ///< With its rhythm, if it has one.

  double rhythm_gain = 0.0;  ///< LearnedRhythm::held_out_gain.

  /// False if less than two visits tell of the group: nothing passes between them, and the chain is
  /// the uniform one of the prior that the other groups share.
  bool learned = false;
};

/// The chains of a map's groups from what visits said of them: LearnChains, the mean of both
/// structures, then LearnRhythm, which goes on from the more probable one.
///
/// A group's rows are put in the order of time, whatever order they come in; one that is there
/// twice (same report and visit) counts once. Whether two rows of different reports are about the
/// same visit is the caller's to know.
/// @param groups    By signature. Their chains and probabilities are not read.
/// @param evidence  Of any landmarks, in any order; rows of others are left out.
/// Returns one per group. Determinism: the same bits for any order of `evidence`.
/// Errors: kInvalidArgument, as LearnChains, LearnRhythm and Validate.
StatusOr<std::vector<GroupChain>> LearnGroupChains(const std::vector<LandmarkGroup>& groups,
                                                   const std::vector<EvidenceRow>& evidence,
                                                   const GroupChainOptions& options);

}  // namespace shiftmap
