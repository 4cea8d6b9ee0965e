// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/audit_rows.h"

#include <fmt/format.h>

#include <utility>

#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {

const char* ToString(AuditAction action) {
  switch (action) {
    case AuditAction::kCommit:
      return "commit";
    case AuditAction::kPublish:
      return "publish";
    case AuditAction::kRollback:
      return "rollback";
    case AuditAction::kReturn:
      return "return";
    case AuditAction::kUpload:
      return "upload";
    case AuditAction::kWait:
      return "wait";
    case AuditAction::kRefuse:
      return "refuse";
    case AuditAction::kLocate:
      return "locate";
    case AuditAction::kExclude:
      return "exclude";
    case AuditAction::kHold:
      return "hold";
    case AuditAction::kInclude:
      return "include";
    case AuditAction::kEdit:
      return "edit";
    case AuditAction::kUndo:
      return "undo";
    case AuditAction::kCompact:
      return "compact";
    case AuditAction::kMigrate:
      return "migrate";
    case AuditAction::kLeave:
      return "leave";
  }
  return "";
}

Status InsertAudit(Database& database,
                   std::optional<std::int64_t> area_id,
                   AuditAction action,
                   const std::string& subject,
                   Stamp written) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql("audit", "written_ns, area_id, action, subject")));
  row.Bind(ToNanoseconds(written), area_id, ToString(action), subject);
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
  query.Bind(area_id,
             ToString(AuditAction::kPublish),
             ToString(AuditAction::kRollback),
             ToNanoseconds(at));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return std::optional<VersionNumber>();
  return std::optional(VersionNumber(query.Int64(0)));
}

StatusOr<std::vector<AuditEntry>> ReadAudit(Database& database,
                                            std::optional<std::int64_t> area_id,
                                            const std::vector<AuditAction>& only) {
  std::string actions;
  for (const AuditAction action : only) {
    actions += fmt::format("{}'{}'", actions.empty() ? "" : ", ", ToString(action));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          fmt::format("SELECT written_ns, coalesce(name, ''), action, subject FROM audit "
                      "LEFT JOIN area USING (area_id) WHERE (?1 IS NULL OR area_id = ?1) {}"
                      "ORDER BY audit_id",
                      only.empty() ? "" : fmt::format("AND action IN ({}) ", actions))));
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
