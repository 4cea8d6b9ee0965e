// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/known_map_leaf.h"

#include <cmath>

namespace shiftmap {
namespace {

// @param log_into, log_from  Probabilities of `absent`.
void MergePlaces(double log_into,
                 double log_from,
                 const Leaf& from,
                 const PlaceBelief& other,
                 Leaf* into,
                 PlaceBelief* belief) {
  const double total = LogAdd(log_into, log_from);
  if (total == kLogZero) return;
  const double share_into = std::exp(log_into - total) * belief->place_probability;
  const double share_from = std::exp(log_from - total) * other.place_probability;
  const UnknownPlace* const place =
      share_from > share_into ? from.filter.FindPlace(other.group) : nullptr;
  belief->place_probability = place ? share_from : share_into;
  if (!place) return;
  into->filter.AdoptPlace(*place);
  belief->log_missed[0] = other.log_missed[0];
}

}  // namespace

void Absorb(double log_share_into, double log_share_from, const Leaf& from, Leaf* into) {
  for (std::size_t i = 0; i < into->beliefs.size(); ++i) {
    PlaceBelief& belief = into->beliefs[i];
    const PlaceBelief& other = from.beliefs[i];
    if (belief.resolved == other.resolved && belief.resolved != GroupBelief::kUnresolved) continue;
    MergePlaces(log_share_into + belief.LogProbability(0),
                log_share_from + other.LogProbability(0),
                from,
                other,
                into,
                &belief);
    MixStates(log_share_into, log_share_from, other, &belief);
  }
}

}  // namespace shiftmap
