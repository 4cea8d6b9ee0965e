// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Sightings whose place others of the same visit confirm by dead reckoning, so many that they make
/// a mode. Each other one may be of a misread signature.
IndexedVector<SightingIndex, bool> AgreeingSightings(const ModeOptions& options,
                                                     const MappingRun& run,
                                                     const FrameMotions& motions);

/// The visits that have none of some sightings.
IndexedVector<VisitIndex, bool> VisitsWithout(const MappingRun& run,
                                              const IndexedVector<SightingIndex, bool>& sightings);

/// A run with some sightings alone, and without the visits that have none of them. Key frames stay.
MappingRun OnlySightings(const MappingRun& run, const IndexedVector<SightingIndex, bool>& kept);

/// A run's data without its unconfirmed visits, BuildRun::unconfirmed.
MappingRun WithoutUnconfirmed(const BuildRun& run);

/// Sightings that a run's map may rest on. A visit is unconfirmed if none of its sightings agrees
/// with others (AgreeingSightings). One that ties the map is not trusted: it fits, and the others
/// neither confirm it, as in ConfirmVisits(), nor know its place without it. Where more than a
/// tenth of such visits fit nowhere, signatures are misread often, and the agreeing sightings alone
/// are trusted. A sensor that sees most landmarks in passing, once or twice, has few of these:
/// where few of its visits fit nowhere all are trusted, and up to 40 % those that tie nothing.
/// @param build  Of one run, from all sightings, solved.
IndexedVector<SightingIndex, bool> TrustedSightings(const MapperOptions& options,
                                                    const BuildState& build);

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
