// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

#include "mapper/map_problem.h"
#include "mapper/mapper_options.h"
#include "mapper/selection/mode_sequence.h"

namespace shiftmap {

/// A visit of a group, wherever it is.
struct VisitRef {
  int run = 0;
  int visit = 0;
};

/// The visits of every group over all runs, in the order of time.
std::vector<std::vector<VisitRef>> VisitsByGroup(const MapProblem& problem);

/// Log-likelihood of a visit under every state of its group: entry 0 is `absent` (every sighting
/// clutter or new), entry 1 + i is mode i, from which every sighting is either a detection or
/// clutter.
Eigen::VectorXd VisitLogLikelihood(const MapProblem& problem,
                                   const VisitRef& visit,
                                   const ModeOptions& options);

/// The chain of one group, IJRR (19): the steps are its visits, the states `absent` and the group's
/// modes, with the real time between visits.
ModeSequenceProblem MakeGroupSequence(const MapProblem& problem,
                                      const std::vector<VisitRef>& visits,
                                      std::size_t group,
                                      const ModeOptions& options);

/// Assigns every visit the mode that the selector of the options gives it. Returns how many
/// assignments changed.
int SelectModes(const ModeOptions& options, MapProblem* problem);

/// Makes a mode for visits that no mode explains, where enough of their sightings agree on a place.
/// Returns how many modes were made.
int CreateModes(const ModeOptions& options, MapProblem* problem);

/// Merges modes of one group that are one place, and drops modes that hold at no visit, except
/// those of the prior map: what was rejected today recurs later.
/// @param mode_covariance  Joint, flat order. [m²]
/// Returns how many modes were merged.
int MergeModes(const ModeOptions& options,
               const Eigen::MatrixXd& mode_covariance,
               MapProblem* problem);

/// Drops modes that hold at no visit, except those of the prior map: what holds nowhere today
/// recurs later.
void DropUnusedModes(MapProblem* problem);

/// Solves the whole problem: selection, mode creation, merging and the continuous part in turn,
/// until nothing changes or a state recurs. Returns the number of alternations. The max-mixture
/// selects at every linearization of the continuous part instead of once it is solved.
int RefineModes(const MapperOptions& options, MapProblem* problem);

}  // namespace shiftmap
