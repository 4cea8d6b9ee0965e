// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/audit_rows.h"

#include <utility>

#include "mapstore/store/version_rows.h"

namespace shiftmap {

Status InsertAudit(Database& database,
                   std::optional<std::int64_t> area_id,
                   const char* action,
                   const std::string& subject,
                   Stamp written) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare("INSERT INTO audit (written_ns, area_id, action, subject) "
                       "VALUES (?1, ?2, ?3, ?4)"));
  row.Bind(ToNanoseconds(written), area_id, action, subject);
  return row.Execute();
}

StatusOr<std::optional<VersionNumber>> PublishedBy(Database& database,
                                                   std::int64_t area_id,
                                                   Stamp at) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT CAST(subject AS INTEGER) FROM audit WHERE area_id = ?1 "
                       "AND action IN (?2, ?3) AND written_ns <= ?4 "
                       "ORDER BY audit_id DESC LIMIT 1"));
  query.Bind(area_id, kPublishAction, kRollbackAction, ToNanoseconds(at));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return std::optional<VersionNumber>();
  return std::optional(VersionNumber(query.Int64(0)));
}

StatusOr<std::vector<AuditEntry>> ReadAudit(Database& database,
                                            std::optional<std::int64_t> area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT written_ns, coalesce(name, ''), action, subject FROM audit "
                       "LEFT JOIN area USING (area_id) WHERE ?1 IS NULL OR area_id = ?1 "
                       "ORDER BY audit_id"));
  query.Bind(area_id);
  std::vector<AuditEntry> entries;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return entries;
    AuditEntry entry;
    entry.written = StampFromNanoseconds(query.Int64(0));
    entry.area = query.Text(1);
    entry.action = query.Text(2);
    entry.subject = query.Text(3);
    entries.push_back(std::move(entry));
  }
}

}  // namespace shiftmap
