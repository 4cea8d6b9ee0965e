// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <vector>

#include "localizer/hypothesis/group_belief.h"

namespace shiftmap {

/// A complete hypothesis: a filter, its weight, and a belief for every group under evaluation. All
/// leaves of a tree hold beliefs for the same groups in the same order.
///
/// `Filter` estimates the pose, and the map if it is a SLAM filter: `PoseWithCovariance Pose()
/// const`. How two leaves become one is up to the filter: the overload, found by its argument, of
///
///     void Absorb(double log_share_into, double log_share_from,
///                 const BasicLeaf<Filter, Belief>& from, BasicLeaf<Filter, Belief>* into);
///
/// merges filters and beliefs of the lighter leaf into those of the heavier one.
template <class FilterType, class BeliefType = GroupBelief>
struct BasicLeaf {
  using Filter = FilterType;
  using Belief = BeliefType;

  Filter filter;
  double log_weight = 0.0;
  std::vector<Belief> beliefs = {};  ///< By group.
  std::uint64_t agreement_key = 0;   ///< Scratch of MergeLeaves().
};

}  // namespace shiftmap
