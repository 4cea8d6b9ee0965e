// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/selection/mode_sequence.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/mode_chain.h"

namespace shiftmap {

/// One visit of a group.
struct VisitStep {
  Eigen::VectorXd log_likelihood;  ///< Of all that was seen in the visit, per state.
  Stamp begin;                     ///< Of the visit.
  Stamp end;
};

/// A chain whose steps are visits: Π(gap) in between, Π = I inside.
ModeSequenceProblem MakeVisitSequence(Eigen::VectorXd log_initial,
                                      const ModeChain& chain,
                                      const std::vector<VisitStep>& visits);

}  // namespace shiftmap
