// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Visits of which fewer sightings agree, by dead reckoning, than a mode needs: each may be of a
/// misread signature. If such visits have most of the run's sightings, none is returned: the others
/// would be too few for a map.
IndexedVector<VisitIndex, bool> UnconfirmedVisits(const ModeOptions& options,
                                                  const MappingRun& run,
                                                  const FrameMotions& motions);

/// True if over a fifth of such visits have no sighting at the place of their landmark in a map of
/// all visits: the run misreads signatures too often to trust these visits.
bool MisreadsMany(const BuildState& build, const IndexedVector<VisitIndex, bool>& unconfirmed);

/// Confirms visits of a solved build by the map of the others; nothing is solved.
/// A visit puts its landmark at p_v, the map has it at p_k, one of K modes; without the visit their
/// difference has the covariance S_k. A share ε of such visits is misread, anywhere in the area A
/// that the sensor sees:
///
///   Pr(read right | p_v) = (1 - ε) f / ((1 - ε) f + ε / A),   f = Σ_k N(p_v - p_k; 0, S_k) / K
///
/// with ε by expectation maximization over all of them. A visit is confirmed at
/// ConfirmationOptions::min_probability: where S_k is large, as after a stretch without landmarks,
/// a single sighting decides nothing. Where S_k is small, it counts like any other. Sightings of
/// several visits that agree on a place of a landmark that has no mode make one. Returns how many
/// visits were confirmed.
int ConfirmVisits(const MapperOptions& options, BuildState* build);

}  // namespace shiftmap
