// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <set>

#include "mapper/mapper_options.h"
#include "mapper/registration/mode_match.h"
#include "mapper/state/build_state.h"

namespace shiftmap {

/// Per group and mode, how many runs have it. That the prior map does counts for nothing: landmarks
/// may have moved since.
using Owners = IndexedVector<GroupIndex, IndexedVector<GroupModeIndex, int>>;

Owners OwnersOf(const BuildState& build);

/// Counts a run once more, or once less.
void AddOwner(const BuildRun& run, int change, Owners* owners);

/// @param others  Must outlive the result.
ModeFilter HasOwner(const Owners& others);

/// How the visits of a run agree with the others. Only visits that make a mode count.
struct Agreement {
  int shared = 0;                  ///< Are where others have their landmark.
  int contradicting = 0;           ///< Are of landmarks that others know elsewhere.
  int contradicting_row = 0;       ///< Most of these in a row.
  std::set<GroupIndex> elsewhere;  ///< Their landmarks.
};

Agreement AgreementOf(const ModeOptions& options, const BuildRun& run, const Owners& others);

/// Of the visits from `begin` to `end`.
Agreement AgreementOf(
    const ModeOptions& options, const BuildRun& run, const Owners& others, Stamp begin, Stamp end);

/// Whether a part of a run may be deformed rather than its landmarks moved: some in a row, but for
/// one between two of them, are displaced together. Landmarks that move do so each by itself.
bool MayBeDeformed(const MapperOptions& options,
                   const BuildState& build,
                   const Owners& others,
                   const BuildRun& run);

/// Per visit of a run the mode of others that it is at, nearer than a distance, or kUnassigned.
IndexedVector<VisitIndex, OptionalMode> MatchVisits(const MapperOptions& options,
                                                    const BuildState& build,
                                                    const Owners& others,
                                                    const BuildRun& run,
                                                    double same_place_m);

/// The run with each landmark at the place of others that it is nearest to, whatever that bends.
BuildRun Pulled(const MapperOptions& options,
                const BuildState& build,
                const Owners& others,
                const BuildRun& run);

/// A run by itself as it is assigned, solved with the modes of others held. What is unassigned is
/// at modes of its own.
BuildState SolvedAmong(const MapperOptions& options,
                       const BuildState& build,
                       const Owners& others,
                       const BuildRun& run);

/// What a run costs that is solved among others, with its own modes.
double CostAmong(const BuildState& solved);

/// Whether others bend a run that is solved among them by no more than its errors and theirs do.
bool FitsAmong(const MapperOptions& options, BuildState solved);

}  // namespace shiftmap
