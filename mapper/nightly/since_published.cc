// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/since_published.h"

#include <fmt/format.h>

#include <charconv>
#include <filesystem>
#include <system_error>
#include <vector>

#include "mapstore/cli/store_access.h"

namespace shiftmap {

VersionNumber VersionOf(const AuditEntry& entry) {
  VersionNumber::Value number = 0;
  std::from_chars(entry.subject.data(), entry.subject.data() + entry.subject.size(), number);
  return VersionNumber(number);
}

StatusOr<SincePublished> ReadSincePublished(const std::string& area, MapStore* store) {
  SincePublished since;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> audit,
                            store->AuditLog(area,
                                            {AuditAction::kPublish,
                                             AuditAction::kRollback,
                                             AuditAction::kRefuse,
                                             AuditAction::kInclude}));
  for (const AuditEntry& entry : audit) {
    if (entry.Is(AuditAction::kRefuse)) {
      const std::size_t blank = entry.subject.find(' ');
      since.refused[VersionOf(entry)] =
          blank == std::string::npos ? "" : entry.subject.substr(blank + 1);
    } else if (entry.Is(AuditAction::kInclude)) {
      since.included.insert(entry.subject.substr(0, entry.subject.find(": ")));
    } else {
      since.published = entry.written;
      since.refused.clear();
    }
  }
  return since;
}

StatusOr<SincePublished> ReadSincePublished(const std::string& area,
                                            const std::string& store,
                                            const Context& context) {
  std::error_code error;
  if (!std::filesystem::exists(store, error)) return SincePublished();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore opened,
                            OpenStore(store, MapStore::Access::kReadOnly, context));
  StatusOr<SincePublished> since = ReadSincePublished(area, &opened);
  if (since.status().code() == StatusCode::kNotFound) return SincePublished();
  return since;
}

StatusOr<std::string> PublishCommand(const std::string& area,
                                     VersionNumber version,
                                     MapStore* store) {
  std::string command = fmt::format("shiftmap-inspect publish {}", version.value());
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store->PublishedVersion(area));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  for (const VersionSummary& of : versions) {
    // It expects the parent to be published, unless it is told otherwise.
    if (of.version != version || !published || of.parent == published) continue;
    command += fmt::format(" --expected {}", published->value());
  }
  return command;
}

}  // namespace shiftmap
