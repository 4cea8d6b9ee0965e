// SPDX-License-Identifier: Apache-2.0
#include "mapper/state/visit_ref.h"

#include <algorithm>

namespace shiftmap {

IndexedVector<GroupIndex, std::vector<VisitRef>> VisitsByGroup(const BuildState& build) {
  IndexedVector<GroupIndex, std::vector<VisitRef>> by_group(build.modes.size());
  for (const RunIndex r : build.runs.indices()) {
    const auto& visits = build.runs[r].data->visits;
    for (const VisitIndex v : visits.indices()) {
      if (!build.runs[r].IsUnconfirmed(v)) by_group[visits[v].group].push_back({r, v});
    }
  }
  for (std::vector<VisitRef>& visits : by_group) {
    std::stable_sort(visits.begin(), visits.end(), [&](const VisitRef& a, const VisitRef& b) {
      return VisitOf(build, a).begin < VisitOf(build, b).begin;
    });
  }
  return by_group;
}

const MappingVisit& VisitOf(const BuildState& build, const VisitRef& ref) {
  return build.runs[ref.run].data->visits[ref.visit];
}

OptionalMode AssignmentOf(const BuildState& build, const VisitRef& ref) {
  return build.runs[ref.run].assignment[ref.visit];
}

OptionalMode& AssignmentOf(BuildState* build, const VisitRef& ref) {
  return build->runs[ref.run].assignment[ref.visit];
}

}  // namespace shiftmap
