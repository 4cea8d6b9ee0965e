// SPDX-License-Identifier: Apache-2.0
//
// The half of MapStore that takes in what shifts report, and that tells a server of changes.
#include <algorithm>
#include <string>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/map/shift_report_check.h"
#include "mapstore/map_store.h"
#include "mapstore/store/audit_rows.h"
#include "mapstore/store/checkpoint_upkeep.h"
#include "mapstore/store/exclusion_rows.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/report_summary.h"
#include "mapstore/store/store_state.h"

namespace shiftmap {
namespace {

// What an audit entry says of the caller of a server.
std::string By(const std::string& subject, const std::string& by) {
  return by.empty() ? subject : fmt::format("{} by {}", subject, by);
}

Stamp EndOf(const ShiftReport& report) {
  Stamp end = report.end;
  for (const VisitEvidence& visit : report.evidence) end = std::max(end, visit.end);
  return end;
}

}  // namespace

Status MapStore::CheckClock(const ShiftReport& report) const {
  return CheckNotInFuture(fmt::format("{}: shift report {}", state_->database.name(), report.uuid),
                          EndOf(report),
                          state_->clock(),
                          state_->clock_tolerance_s);
}

Status MapStore::State::CheckReport(const ShiftReport& report) const {
  if (const Status valid = ValidateShiftReport(report); !valid.ok()) {
    return InvalidArgument("{}: shift report {}: {}", database.name(), report.uuid, Message(valid));
  }
  return OkStatus();
}

StatusOr<MapStore::State::Reportable> MapStore::State::FindReported(const ShiftReport& report) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, report.area));
  SHIFTMAP_ASSIGN_OR_RETURN(VersionRow version,
                            GetVersion(database, report.area, area_row.area_id, report.version));
  if (report.content_hash != version.content_hash) {
    return InvalidArgument("{}: shift report {}: content hash {}, expected {}",
                           VersionName(report.area, report.version),
                           report.uuid,
                           report.content_hash,
                           version.content_hash);
  }
  return Reportable{area_row, std::move(version)};
}

Status MapStore::State::HoldIfBeforeItsMap(const ShiftReport& report,
                                           const Reportable& reported,
                                           InsertedReport* inserted) {
  const Stamp end = EndOf(report);
  // A version may be ahead of the time at which it was made, and that of the time that it is.
  const Stamp made = std::min(reported.version.stamp, reported.version.created);
  // A recorded log may be localized on a newer map.
  const bool live = report.run_hash.empty();
  if (!live || report.begin < kFirstPlausibleStamp || made > LatestStamp() ||
      end + FromSeconds(clock_tolerance_s) >= made) {
    return OkStatus();
  }
  Exclusion hold;
  hold.run = inserted->run;
  hold.held = true;
  hold.excluded = inserted->received;
  hold.reason = fmt::format(
      "its clock is behind: it ends at {} UTC, and was driven on version {}, which is of {} UTC",
      FormatUtc(end),
      reported.version.number.value(),
      FormatUtc(made));
  const std::int64_t area_id = reported.area.area_id;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool included, WasIncluded(database, area_id, hold.run));
  if (included) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool added, InsertExclusion(database, area_id, hold));
  if (!added) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const bool known, IsKnownOtherwise(database, inserted->report_id));
  if (known) inserted->changed_from = Stamp::min();
  return AuditExclusion(area_id, hold);
}

Status MapStore::State::ExcludeIfExpected(const ShiftReport& report,
                                          std::int64_t area_id,
                                          InsertedReport* inserted) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      const std::optional<Exclusion> exclusion,
      ExcludeRunOfReport(
          database, area_id, LowerCaseUuid(report.uuid), inserted->run, inserted->received));
  if (!exclusion) return OkStatus();
  // It takes out all that is known of the run.
  inserted->changed_from = Stamp::min();
  return AuditExclusion(area_id, *exclusion);
}

StatusOr<ReturnResult> MapStore::State::AddReport(const ShiftReport& report,
                                                  const Reportable& reported,
                                                  const std::string& by) {
  const auto& [area_row, version] = reported;
  std::optional<VersionRow> published;
  if (area_row.published) {
    SHIFTMAP_ASSIGN_OR_RETURN(published, PublishedRow(report.area, area_row));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(InsertedReport inserted,
                            InsertReport(database, area_row.area_id, version, report, clock()));
  SHIFTMAP_RETURN_IF_ERROR(ExcludeIfExpected(report, area_row.area_id, &inserted));
  SHIFTMAP_RETURN_IF_ERROR(HoldIfBeforeItsMap(report, reported, &inserted));
  ReturnResult result;
  result.evidence_rows = static_cast<int>(report.evidence.size());
  std::string owner = AreaName(report.area);
  if (published) {
    owner = VersionName(report.area, published->number);
    SHIFTMAP_ASSIGN_OR_RETURN(ModeNumbers* const mode_numbers, NumbersOf(*published));
    SHIFTMAP_ASSIGN_OR_RETURN(
        result.set_aside,
        CountSetAside(database, *published, version, inserted, report, mode_numbers));
  }
  SHIFTMAP_RETURN_IF_ERROR(KeepCheckpoints(database,
                                           area_row.area_id,
                                           inserted,
                                           result.evidence_rows,
                                           published,
                                           checkpoint_rows,
                                           owner));
  SHIFTMAP_RETURN_IF_ERROR(
      InsertAudit(database, area_row.area_id, AuditAction::kReturn, By(report.uuid, by)));
  return result;
}

StatusOr<ReturnResult> MapStore::Return(const ShiftReport& report, const std::string& by) {
  SHIFTMAP_RETURN_IF_ERROR(state_->CheckReport(report));
  SHIFTMAP_RETURN_IF_ERROR(CheckClock(report));
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  ReturnResult result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.duplicate, HasReport(state_->database, report.uuid));
  if (result.duplicate) return result;
  SHIFTMAP_ASSIGN_OR_RETURN(const State::Reportable reported, state_->FindReported(report));
  SHIFTMAP_ASSIGN_OR_RETURN(result, state_->AddReport(report, reported, by));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  return result;
}

Status MapStore::State::AddReports(const std::vector<AttributedReport>& reports,
                                   std::vector<StatusOr<ReturnResult>>* results) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, Write());
  for (std::size_t i = 0; i < reports.size(); ++i) {
    StatusOr<ReturnResult>& result = (*results)[i];
    if (!result.ok()) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(result->duplicate, HasReport(database, reports[i].report.uuid));
    if (result->duplicate) continue;
    const StatusOr<Reportable> reported = FindReported(reports[i].report);
    if (!reported.ok()) {
      result = reported.status();
      continue;
    }
    // What fails from here on may have left rows.
    SHIFTMAP_ASSIGN_OR_RETURN(*result, AddReport(reports[i].report, *reported, reports[i].by));
  }
  return transaction.Commit();
}

std::vector<StatusOr<ReturnResult>> MapStore::ReturnAll(
    const std::vector<AttributedReport>& reports) {
  std::vector<StatusOr<ReturnResult>> results;
  for (const AttributedReport& each : reports) {
    Status valid = state_->CheckReport(each.report);
    if (valid.ok()) valid = CheckClock(each.report);
    results.push_back(valid.ok() ? StatusOr<ReturnResult>(ReturnResult()) : valid);
  }
  if (reports.size() > 1 && state_->AddReports(reports, &results).ok()) return results;
  // One by one, so that one that fails fails alone.
  for (std::size_t i = 0; i < reports.size(); ++i) {
    results[i] = Return(reports[i].report, reports[i].by);
  }
  return results;
}

Status MapStore::NoteUpload(const std::string& log, const std::string& by) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  SHIFTMAP_RETURN_IF_ERROR(InsertAudit(
      state_->database, std::nullopt, AuditAction::kUpload, By(log, by), state_->clock()));
  return transaction.Commit();
}

StatusOr<std::vector<ReceivedRun>> MapStore::ReceivedRuns(const std::string& area) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT r.identity, r.vehicle, r.begin_ns, r.end_ns, r.received_ns, "
          "iif(r.run_hash = '', v.number, NULL) FROM shift_report r JOIN version v "
          "USING (version_id) WHERE v.area_id = ?1 UNION ALL "
          "SELECT substr(subject, 1, 64), '', 0, 0, written_ns, NULL FROM audit WHERE action = ?2 "
          "ORDER BY 5, 1"));
  query.Bind(area_row.area_id, ToString(AuditAction::kUpload));
  std::vector<ReceivedRun> received;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return received;
    ReceivedRun run{query.Text(0),
                    query.Text(1),
                    StampFromNanoseconds(query.Int64(2)),
                    StampFromNanoseconds(query.Int64(3)),
                    StampFromNanoseconds(query.Int64(4)),
                    std::nullopt};
    if (!query.IsNull(5)) run.driven_on = VersionNumber(query.Int64(5));
    received.push_back(std::move(run));
  }
}

StatusOr<std::int64_t> MapStore::DataVersion() {
  return state_->database.QueryInt64("PRAGMA data_version");
}

StatusOr<StoreChanges> MapStore::ChangesSince(std::int64_t position) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  StoreChanges changes;
  SHIFTMAP_ASSIGN_OR_RETURN(changes.position,
                            database.QueryInt64("SELECT coalesce(max(audit_id), 0) FROM audit"));
  // A backup that was restored may tell of fewer writes.
  if (changes.position < position) position = 0;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT a.name, p.number, p.created_ns, coalesce(u.last, 0), (SELECT count(*) "
          "FROM shift_report r WHERE EXISTS (SELECT 1 FROM exclusion e WHERE e.area_id = a.area_id "
          "AND e.held AND e.included_ns IS NULL AND (e.run = r.identity "
          "OR (e.run <> '' AND e.run = r.run_hash) OR (e.run = '' AND e.vehicle = r.vehicle AND "
          "e.since_ns <= r.begin_ns))) "
          "AND r.version_id IN (SELECT version_id FROM version v WHERE v.area_id = a.area_id) "
          "AND EXISTS (SELECT 1 FROM exclusion e WHERE e.held AND e.included_ns IS NULL)) "
          "FROM area a LEFT JOIN version p ON p.version_id = a.published_version_id "
          "LEFT JOIN (SELECT area_id, max(audit_id) AS last FROM audit WHERE audit_id > ?1 "
          "AND action NOT IN (?2, ?3) GROUP BY area_id) u ON u.area_id = a.area_id "
          "ORDER BY a.name"));
  query.Bind(position, ToString(AuditAction::kCommit), ToString(AuditAction::kWait));
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return changes;
    AreaState area;
    area.area = query.Text(0);
    if (!query.IsNull(1)) area.published = VersionNumber(query.Int64(1));
    if (!query.IsNull(2)) area.created = StampFromNanoseconds(query.Int64(2));
    area.last_change = query.Int64(3);
    area.held_reports = query.Int64(4);
    changes.areas.push_back(std::move(area));
  }
}

}  // namespace shiftmap
