// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "localizer/filter/known_map_filter.h"
#include "localizer/hypothesis/log_math.h"
#include "localizer/hypothesis/state_values.h"

namespace shiftmap {

/// What one leaf holds about one group.
///
/// Either a mode (or `absent`) is *resolved*: the leaf is the hypothesis that it holds; or the leaf
/// stands for several states that share its filter, because nothing was seen that tells their poses
/// apart (T-IV VI-A, for every mode and not only for the alternative hypothesis).
struct GroupBelief {
  static constexpr int kUnresolved = -1;

  int group = 0;               ///< Index into MapSnapshot::groups().
  int resolved = kUnresolved;  ///< State 0..n.
  StateValues log_p;           ///< Unresolved: log-probability per state given the leaf, sums to 1.
  StateValues log_missed;      ///< Σ log(1 - P_D) of the present run of misses, per state.

  /// If `absent` holds: that the landmark stands at KnownMapFilter::FindPlace(), log_missed[0] is
  /// of that place.
  double place_probability = 0.0;

  int states() const { return static_cast<int>(log_p.size()); }

  double LogProbability(int state) const {
    if (resolved == kUnresolved) return log_p[static_cast<std::size_t>(state)];
    return state == resolved ? 0.0 : kLogZero;
  }
};

/// A complete hypothesis: a pose filter, its weight, and a belief for every group under evaluation.
/// All leaves of a bank hold beliefs for the same groups in the same order.
struct Leaf {
  KnownMapFilter filter;
  double log_weight = 0.0;
  std::vector<GroupBelief> beliefs;  ///< By group.
  std::uint64_t agreement_key = 0;   ///< Scratch of MergeLeaves().
};

}  // namespace shiftmap
