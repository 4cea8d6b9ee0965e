// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// The sequence that maximizes LogJoint, IJRR (19): exact, by dynamic programming (Viterbi 1967) in
/// O(T n²),
///
///   b_t(k) = log p(z_t | k) + max over i of [ b_{t-1}(i) + log p(δ_t = k | δ_{t-1} = i) ].
///
/// Of equal ones the one with the smallest states, last step first.
std::vector<int> MostLikelyModes(const ModeSequenceProblem& problem);

}  // namespace shiftmap
