// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/refused_versions.h"

#include <algorithm>
#include <set>
#include <utility>
#include <vector>

#include "mapstore/cli/store_access.h"
#include "mapstore/maintenance/compact.h"

namespace shiftmap {
namespace {

// What nobody can want to publish any more and still has its content.
StatusOr<std::vector<VersionNumber>> FindSuperseded(const std::string& area, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(area, store));
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::vector<AuditEntry> audit,
      store->AuditLog(area, {AuditAction::kRefuse, AuditAction::kPublish, AuditAction::kRollback}));
  std::set<VersionNumber> refused;
  std::set<VersionNumber> published;
  for (const AuditEntry& entry : audit) {
    (entry.Is(AuditAction::kRefuse) ? refused : published).insert(VersionOf(entry));
  }
  std::vector<VersionNumber> superseded;
  for (const VersionSummary& version : versions) {
    const bool newest = !since.refused.empty() && version.version == since.refused.rbegin()->first;
    if (newest || !version.content_stored || !refused.contains(version.version) ||
        published.contains(version.version)) {
      continue;
    }
    superseded.push_back(version.version);
  }
  return superseded;
}

}  // namespace

StatusOr<RefusedVersions> ReadRefused(const std::string& area, MapStore* store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(area, store));
  RefusedVersions refused{static_cast<int>(since.refused.size())};
  for (const auto& [version, reasons] : since.refused) {
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance, store->LoadProvenance(area, version));
    for (const RunRecord& run : provenance.runs) refused.until = std::max(refused.until, run.begin);
  }
  return refused;
}

Status CompactRefused(const std::string& area, const std::string& store, const Context& context) {
  std::vector<VersionNumber> superseded;
  {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore opened,
                              OpenStore(store, MapStore::Access::kReadOnly, context));
    StatusOr<std::vector<VersionNumber>> found = FindSuperseded(area, &opened);
    if (found.status().code() == StatusCode::kNotFound) return OkStatus();
    if (!found.ok()) return found.status();
    superseded = *std::move(found);
  }
  if (superseded.empty()) return OkStatus();
  return CompactVersions(store, area, superseded).status();
}

}  // namespace shiftmap
