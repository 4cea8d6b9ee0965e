// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"

namespace shiftmap {

/// A move rate (MoveRate), and how well the visits behind it tell it.
struct MoveRateEstimate {
  double rate_per_s = 0.0;
  double low_per_s = 0.0;  ///< Ends of the 95 % interval.
  double high_per_s = 0.0;
  int visits = 0;  ///< That tell of it.
};

/// The 95 % interval of the move rate of a chain, taken as uniform, that was observed at visits.
///
/// Fisher information about log λ, each visit taken as certain: Σ (λ p')² / (p (1 - p)) over the
/// gaps Δ, with p the probability of another mode after Δ, and half a jump for the prior
/// (GroupChainOptions::prior_jumps). The interval is λ exp(±1.96 / sqrt(information)).
/// @param rate_per_s  The version's. 0: the interval is 0 too.
/// @param states      Of the chain: modes and `absent`.
/// @param visits      Times of the visits that count, ascending.
MoveRateEstimate EstimateMoveRate(double rate_per_s, int states, const std::vector<Stamp>& visits);

/// The same of all landmarks of a map.
/// @param evidence  Of the map's version (MapStore::Evidence); visits after the map's stamp are
/// left
///                  out.
using MoveRates = std::map<Signature, MoveRateEstimate>;
MoveRates EstimateMoveRates(const MapSnapshot& map, const std::vector<EvidenceRow>& evidence);

}  // namespace shiftmap
