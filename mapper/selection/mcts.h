// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// How a Monte Carlo tree search completes a sequence behind the tree. IJRR leaves it open.
enum class RollOutPolicy {
  kUniform,  ///< Every state alike.
  kModel,    ///< In proportion to ψ, IJRR (11): transition times likelihood.
};

struct MctsOptions {
  /// Sequences tried for every step of the chain; IJRR 8.2.2. Raising it finds better sequences and
  /// takes as much longer.
  int iterations = 200;

  /// Steps that a search looks ahead, the one to decide included; IJRR 8.2.2.
  int depth = 25;

  /// C_p of IJRR (25), which does not print it; √2 is that of Kocsis and Szepesvári.
  double exploration = 1.4142135623730951;

  RollOutPolicy roll_out = RollOutPolicy::kModel;

  /// Searches that run side by side, each with its own tree and its share of the iterations; their
  /// visit counts are added (root parallelization, Chaslot et al. 2008). The result depends on
  /// their number, not on the processor's.
  int trees = 1;
};

/// Monte Carlo tree search, IJRR 5.4. For one step of the chain after the other a tree is grown
/// from the state before it: UCT (25) over normalized mean log-likelihoods (24, 26) selects a node
/// with an unvisited child, one such child, drawn at random, is expanded, a roll-out completes the
/// sequence, and its log-likelihood is recorded on the way back. The child of the root that was
/// visited most becomes the state of the step; of equal ones the smallest. Impossible steps are not
/// tried.
///
/// It approximates what MostLikelyModes() finds exactly. Determinism: by `seed`.
std::vector<int> MostVisitedModes(const ModeSequenceProblem& problem,
                                  const MctsOptions& options,
                                  std::uint64_t seed);

}  // namespace shiftmap
