// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <random>
#include <vector>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap::testing {

/// A random chain: every distribution random, log-likelihoods normal with the given spread.
ModeSequenceProblem RandomSequence(std::mt19937_64& random, int n, int steps, double spread = 2.0);

/// A random chain whose entries are small integers: many sequences are equally likely.
ModeSequenceProblem RandomSequenceWithTies(std::mt19937_64& random, int n, int steps);

/// A chain that stays with probability 1 - change_probability, and observations of the states of
/// `truth`: Gaussian, any two states `separation` standard deviations apart.
ModeSequenceProblem StickySequence(std::mt19937_64& random,
                                   const std::vector<int>& truth,
                                   int n,
                                   double change_probability,
                                   double separation);

/// Calls `visit` with every sequence of `steps` states out of n.
template <typename Visit>
void ForEachSequence(int n, int steps, Visit visit) {
  std::vector<int> states(static_cast<std::size_t>(steps), 0);
  while (true) {
    visit(states);
    std::size_t digit = 0;
    while (digit < states.size() && ++states[digit] == n) states[digit++] = 0;
    if (digit == states.size()) return;
  }
}

}  // namespace shiftmap::testing
