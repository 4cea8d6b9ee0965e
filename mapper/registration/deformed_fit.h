// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Finds more modes of an aligned run map that are modes of the map: a run map of a long run is
/// deformed, and what a rigid transform leaves apart at its ends is one place all the same.
///
/// Given the modes p_M known to stand at z_M in the map, the others are expected at
///
///   p + P_·M (P_MM + R)⁻¹ (z_M - p_M)
///
/// with P the run map's joint covariance, its gauge and scale left free, and are known there by the
/// conditional covariance. One that gates with a mode of its group becomes known too, those known
/// to 0.5 m first, and so on outward until no other does. What the other matches contradict (each
/// left out in turn) is none.
/// @param fixed  Per mode whether `known` is the last word on it.
/// @return `known` with what was found.
KnownModes GrowMatches(const MapperOptions& options,
                       const RunMap& run_map,
                       const BuildState& map,
                       KnownModes known,
                       const ModeFlags& fixed);

/// Finds the modes of a deformed run map in the map and deforms it onto them, in turn until no more
/// are found.
/// @param places   Where the map has them as far as is known yet.
/// @param run_map  Moved into the map frame.
KnownModes FitDeformedRunMap(const MapperOptions& options,
                             const BuildState& map,
                             const ModePlaces& places,
                             RunMap* run_map);

/// What holds a run map's known modes where the map has them, or some of them all over it.
std::vector<GraphPrior> HoldKnown(const MapperOptions& options,
                                  const BuildState& map,
                                  const KnownModes& known,
                                  const RunMap& run_map);

/// Deforms a run map, its trajectory with it, by a solve of its run with some of its modes held.
/// @param steps  Of the solver at most.
void Deform(const MapperOptions& options,
            const std::vector<GraphPrior>& held,
            int steps,
            RunMap* run_map);

/// Deforms a run map so that known modes come to stand where the map has them: some steps that a
/// solve of all runs goes on from.
void DeformOntoMap(const MapperOptions& options,
                   const BuildState& map,
                   const KnownModes& known,
                   RunMap* run_map);

}  // namespace shiftmap
