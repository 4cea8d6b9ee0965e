// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "mapper/state/build_state.h"
#include "mapper/state/visit_ref.h"

namespace shiftmap {

/// Makes the likelihoods of a visit those of the mixture over the alternatives that are kept: of a
/// landmark in doubt, the mode that it may have left has p / (1 - p) of the likelihood of the mode
/// that the visit is assigned to, with p the probability that it stayed. Leaves others as they are,
/// and those of a landmark that is in no doubt any more.
/// @param log_likelihoods  Per state of the group, `absent` first.
void MixAlternatives(const BuildState& build,
                     const VisitRef& visit,
                     Eigen::VectorXd* log_likelihoods);

/// Drops alternatives between which nothing is left to tell: of runs that are not in the map any
/// more, or of landmarks whose two modes have become one.
void DropSettledAlternatives(BuildState* build);

}  // namespace shiftmap
