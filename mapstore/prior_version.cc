// SPDX-License-Identifier: Apache-2.0
#include "mapstore/prior_version.h"

#include <fmt/format.h>

#include <vector>

#include "mapstore/find_version.h"

namespace shiftmap {
namespace {

// What was taken out and a version rests on; empty if nothing.
StatusOr<std::string> TakenOut(const std::string& area, VersionNumber version, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto runs, store->ExcludedRunsOf(area, version));
  if (!runs.empty()) {
    return fmt::format(
        "version {} is made from run '{}', which is excluded", version.value(), runs.front());
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held, store->EditsOf(area, version));
  for (const MapEdit& edit : held) {
    const bool geometry = edit.kind == EditKind::kPosition || edit.kind == EditKind::kNewMode ||
                          edit.kind == EditKind::kControl || edit.kind == EditKind::kSplit;
    if (!edit.undone || !geometry) continue;
    return fmt::format(
        "version {} rests on edit {}, which was taken back", version.value(), edit.id.value());
  }
  return std::string();
}

}  // namespace

StatusOr<std::optional<VersionNumber>> FindPriorVersion(
    const std::string& area,
    VersionNumber version,
    const std::function<void(const std::string& line)>& passed_over,
    MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  std::optional<VersionNumber> at = version;
  while (at) {
    const VersionSummary* const summary = FindVersion(versions, *at);
    if (summary == nullptr) return std::optional<VersionNumber>();
    if (summary->content_stored) {
      SHIFTMAP_ASSIGN_OR_RETURN(const std::string taken_out, TakenOut(area, *at, store));
      if (taken_out.empty()) break;
      if (passed_over) passed_over(taken_out);
    }
    at = summary->parent;
  }
  return at;
}

}  // namespace shiftmap
