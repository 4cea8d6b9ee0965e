// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/state/build_state.h"

namespace shiftmap {

/// A visit of a group, wherever it is.
struct VisitRef {
  RunIndex run;
  VisitIndex visit;
};

/// The visits of every group over all runs, in the order of time, without unconfirmed ones.
IndexedVector<GroupIndex, std::vector<VisitRef>> VisitsByGroup(const BuildState& build);

const MappingVisit& VisitOf(const BuildState& build, const VisitRef& ref);

/// The mode that it is assigned to, or kUnassigned.
OptionalMode AssignmentOf(const BuildState& build, const VisitRef& ref);
OptionalMode& AssignmentOf(BuildState* build, const VisitRef& ref);

}  // namespace shiftmap
