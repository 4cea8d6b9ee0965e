// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/selection/mode_sequence.h"
#include "mapper/state/build_state.h"
#include "mapper/state/visit_ref.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// Log-likelihood of a visit under every state of its group: entry 0 is `absent` (the sightings are
/// clutter, or the landmark is new), entry 1 + i is mode i, from which every sighting is either a
/// detection or clutter. In a build whose runs are placed the sightings of a visit share the error
/// of pose and map (visit_density.h), else each is scored by itself.
Eigen::VectorXd VisitLogLikelihood(const BuildState& build,
                                   const VisitRef& visit,
                                   const ModeOptions& options);

/// The chain of a group's states as they are now: that of the prior map; or, where modes came, one
/// of the same mean rate, as the others say nothing of them; or that of ModeOptions.
ModeChain ChainOf(const BuildState& build, GroupIndex group, const ModeOptions& options);

/// The chain of one group, IJRR (19): the steps are its visits, the states `absent` and the group's
/// modes, with the real time between visits. It starts from what the prior map knew, moved to the
/// first visit, T-IV (13); or, if that visit is older, from the chain's stationary distribution.
ModeSequenceProblem MakeGroupSequence(const BuildState& build,
                                      const std::vector<VisitRef>& visits,
                                      GroupIndex group,
                                      const ModeOptions& options);

/// Assigns every visit the mode that the selector of the options gives it. Returns how many
/// assignments changed.
/// @param threads  On which visits are scored; the result does not depend on it.
int SelectModes(const ModeOptions& options, BuildState* build, int threads = 1);

/// Makes a mode for visits that no mode explains, where enough of their sightings agree on a place.
/// Returns how many modes were made.
int CreateModes(const ModeOptions& options, BuildState* build);

/// Makes a mode at the place of a visit that is far from its own, where the most likely sequence of
/// the group gains by it more than the visit costs as one of a new place. One mode between two
/// places explains visits at both so well that none of them is absent. The error that visits share
/// is what they show (SharedVisitVariance), between ModeOptions::position_floor_m and
/// score_position_sd_m. Returns how many modes were made.
/// @param threads  As of SelectModes().
int SplitModes(const ModeOptions& options, BuildState* build, int threads = 1);

/// Solves the whole build: selection, mode creation, merging and the continuous part in turn,
/// until nothing changes or a state recurs. Returns the number of alternations. The max-mixture
/// selects at every linearization of the continuous part instead of once it is solved.
/// @param solver  What it keeps goes on from and to other solves of this build.
/// @param on_step   Asked before each alternation.
int RefineModes(const MapperOptions& options,
                BuildState* build,
                GraphSolver* solver,
                const StepCallback& on_step = {});

/// As RefineModes(), but where something else goes on from here: the continuous part is left as
/// selection needs it and not solved to its end.
int AlternateModes(const MapperOptions& options,
                   BuildState* build,
                   GraphSolver* solver,
                   const StepCallback& on_step = {});

/// As RefineModes(), but no further than other runs need to be placed in the map: nothing is solved
/// to its end, and modes that are one place are merged.
void UpdateModes(const MapperOptions& options, BuildState* build, const StepCallback& on_step = {});

}  // namespace shiftmap
