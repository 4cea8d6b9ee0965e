// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/rolled_back.h"

#include <map>
#include <optional>

#include "mapstore/core/parse_whole.h"

namespace shiftmap {

std::set<VersionNumber> RolledBackVersions(const std::vector<VersionSummary>& versions,
                                           const std::vector<AuditEntry>& audit) {
  std::map<VersionNumber, std::optional<VersionNumber>> parents;
  for (const VersionSummary& version : versions) parents[version.version] = version.parent;
  const auto parent_of = [&](VersionNumber version) {
    const auto found = parents.find(version);
    return found == parents.end() ? std::nullopt : found->second;
  };
  std::set<VersionNumber> back;
  std::optional<VersionNumber> current;
  for (const AuditEntry& entry : audit) {
    const bool rollback = entry.Is(AuditAction::kRollback);
    if (!rollback && !entry.Is(AuditAction::kPublish)) continue;
    const std::optional<std::int64_t> number = ParseWhole<std::int64_t>(entry.subject);
    if (!number) continue;
    const VersionNumber target(*number);
    if (rollback) {
      for (auto at = current; at && *at != target; at = parent_of(*at)) back.insert(*at);
    } else {
      for (std::optional<VersionNumber> at = target; at; at = parent_of(*at)) back.erase(*at);
    }
    current = target;
  }
  return back;
}

}  // namespace shiftmap
