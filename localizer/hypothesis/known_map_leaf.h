// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "localizer/filter/known_map_filter.h"
#include "localizer/hypothesis/leaf.h"

namespace shiftmap {

/// What a leaf of the localizer holds about a group.
struct PlaceBelief : GroupBelief {
  /// If `absent` holds: that the landmark stands at KnownMapFilter::FindPlace(), log_missed[0] is
  /// of that place.
  double place_probability = 0.0;
};

/// A leaf of the localizer.
using Leaf = BasicLeaf<KnownMapFilter, PlaceBelief>;

/// The heavier one's filter stays, unresolved beliefs mix, and of the places that the two remember
/// for a group the likelier stays.
void Absorb(double log_share_into, double log_share_from, const Leaf& from, Leaf* into);

}  // namespace shiftmap
