// SPDX-License-Identifier: Apache-2.0
#include "mapper/state/visit_ref.h"

#include <algorithm>

namespace shiftmap {

std::vector<std::vector<VisitRef>> VisitsByGroup(const BuildState& build) {
  std::vector<std::vector<VisitRef>> by_group(build.modes.size());
  for (const RunIndex r : build.runs.indices()) {
    const std::vector<MappingVisit>& visits = build.runs[r].data->visits;
    for (std::size_t v = 0; v < visits.size(); ++v) {
      by_group[static_cast<std::size_t>(visits[v].group)].push_back({r, static_cast<int>(v)});
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
  return build.runs[ref.run].data->visits[static_cast<std::size_t>(ref.visit)];
}

int AssignmentOf(const BuildState& build, const VisitRef& ref) {
  return build.runs[ref.run].assignment[static_cast<std::size_t>(ref.visit)];
}

int& AssignmentOf(BuildState* build, const VisitRef& ref) {
  return build->runs[ref.run].assignment[static_cast<std::size_t>(ref.visit)];
}

}  // namespace shiftmap
