// SPDX-License-Identifier: Apache-2.0
//
// The reading half of MapStore.
#include "mapstore/map_store.h"

#include <cstdint>
#include <map>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/core/stamp_check.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/store/audit_rows.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/evidence_rows.h"
#include "mapstore/store/exclusion_rows.h"
#include "mapstore/store/ledger_filter.h"
#include "mapstore/store/provenance_rows.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/report_summary.h"
#include "mapstore/store/store_state.h"
#include "mapstore/store/visibility_rows.h"
#include "proto/core/check.h"

namespace shiftmap {

const char* Describe(SetAside reason) {
  switch (reason) {
    case SetAside::kExcluded:
      return "its run is excluded";
    case SetAside::kHeld:
      return "its run is held";
    case SetAside::kUnknown:
      return "it came later";
    case SetAside::kInMap:
      return "the map accounts for it";
    case SetAside::kRunInMap:
      return "the map was built from its run";
    case SetAside::kSameRun:
      return "another report about its run counts";
    case SetAside::kOtherLine:
      return "made against a version of another line";
    case SetAside::kNoLandmark:
      return "the map does not have the landmark";
    case SetAside::kNoMode:
      return "the map does not have the mode";
    case SetAside::kLaterVersion:
      return "a later version mapped it";
    case SetAside::kAhead:
      return "it is ahead of the clock";
  }
  return "";
}

std::string DescribeVersion(const std::optional<VersionNumber>& version) {
  return version ? fmt::format("version {}", version->value()) : "no version";
}

std::string MapStore::State::AreaName(const std::string& area) const {
  return fmt::format("{}: area '{}'", database.name(), area);
}

std::string MapStore::State::VersionName(const std::string& area, VersionNumber version) const {
  return fmt::format("{}: area '{}': version {}", database.name(), area, version.value());
}

StatusOr<VersionRow> MapStore::State::PublishedRow(const std::string& area,
                                                   const AreaRow& area_row) {
  if (!area_row.published) return NotFound("{}: nothing is published", AreaName(area));
  return GetVersion(database, area, area_row.area_id, *area_row.published);
}

StatusOr<VersionRow> MapStore::State::RowOf(const std::string& area, VersionNumber version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  return GetVersion(database, area, area_row.area_id, version);
}

StatusOr<VersionRow> MapStore::State::SelectRow(const std::string& area,
                                                const AreaRow& area_row,
                                                std::optional<VersionNumber> version,
                                                std::optional<Stamp> known) {
  if (!version) {
    return known ? PublishedRowAt(area, area_row, *known) : PublishedRow(area, area_row);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(VersionRow row, GetVersion(database, area, area_row.area_id, *version));
  if (known && row.created > *known) {
    return NotFound("{}: was made at {} UTC, after {} UTC",
                    VersionName(area, *version),
                    FormatUtc(row.created),
                    FormatUtc(*known));
  }
  return row;
}

StatusOr<VersionRow> MapStore::State::PublishedRowAt(const std::string& area,
                                                     const AreaRow& area_row,
                                                     Stamp at) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<VersionNumber> version,
                            PublishedBy(database, area_row.area_id, at));
  if (version) return GetVersion(database, area, area_row.area_id, *version);
  return NotFound("{}: nothing was published by {} UTC", AreaName(area), FormatUtc(at));
}

Status MapStore::State::RefuseSnapshot(const char* what) {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool snapshot, IsSnapshot(database));
  if (!snapshot) return OkStatus();
  return FailedPrecondition("{}: a snapshot {}", database.name(), what);
}

StatusOr<Transaction> MapStore::State::Change(bool dry_run) {
  if (!dry_run) return Write();
  SHIFTMAP_RETURN_IF_ERROR(CheckNoSnapshot(database));
  return Read();
}

StatusOr<MapStore::State::Filtered> MapStore::State::Filter(const std::string& area,
                                                            std::optional<VersionNumber> version,
                                                            const LedgerQuery& query) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  Filtered filtered;
  SHIFTMAP_ASSIGN_OR_RETURN(filtered.row, SelectRow(area, area_row, version, query.known));
  SHIFTMAP_ASSIGN_OR_RETURN(
      filtered.content,
      ReadContent(database, filtered.row, VersionName(area, filtered.row.number)));
  SHIFTMAP_ASSIGN_OR_RETURN(
      filtered.records,
      ApplyLedger(database, area_row.area_id, filtered.row, query, &filtered.content));
  return filtered;
}

StatusOr<std::map<Signature, Signature>> MapStore::State::AliasesOf(const std::string& area,
                                                                    const VersionRow& version) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<MapEdit> held,
                            ReadHeldEdits(database, area_row.area_id, version.version_id));
  return LandmarkNames(held).Aliases();
}

StatusOr<MapSnapshot> MapStore::State::Load(const std::string& area,
                                            std::optional<VersionNumber> version,
                                            const LedgerQuery& query) {
  SHIFTMAP_ASSIGN_OR_RETURN(Filtered filtered, Filter(area, version, query));
  const VersionNumber number = filtered.row.number;
  if (const Status valid = ValidateStamp(filtered.content.stamp); !valid.ok()) {
    return DataLoss("{}: end of its evidence: {}", VersionName(area, number), Message(valid));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const LedgerPosition position, ReadLedgerPosition(database));
  SHIFTMAP_ASSIGN_OR_RETURN(auto aliases, AliasesOf(area, filtered.row));
  return MapSnapshot(area,
                     number,
                     filtered.row.content_hash,
                     std::move(filtered.content),
                     position,
                     std::move(aliases));
}

MapStore::MapStore(std::unique_ptr<State> state) : state_(std::move(state)) {}
MapStore::MapStore(MapStore&&) noexcept = default;
MapStore& MapStore::operator=(MapStore&&) noexcept = default;
MapStore::~MapStore() = default;

StatusOr<MapStore> MapStore::Open(const std::string& path, const OpenOptions& options) {
  Database::Options database_options;
  switch (options.access) {
    case Access::kReadOnly:
      database_options.mode = Database::Mode::kReadOnly;
      break;
    case Access::kReadWrite:
      database_options.mode = Database::Mode::kReadWrite;
      break;
    case Access::kReadWriteCreate:
      database_options.mode = Database::Mode::kReadWriteCreate;
      break;
  }
  SHIFTMAP_CHECK(options.checkpoint_rows > 0, "checkpoint_rows {}", options.checkpoint_rows);
  SHIFTMAP_CHECK(options.clock && options.clock_tolerance_s >= 0.0,
                 "clock tolerance {} s",
                 options.clock_tolerance_s);
  database_options.busy_timeout = options.lock_timeout;
  database_options.on_wait = options.on_wait;
  database_options.allow_network_file_system = options.allow_network_file_system;
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, database_options));
  return MapStore(std::make_unique<State>(State{
      std::move(database), options.checkpoint_rows, options.clock, options.clock_tolerance_s}));
}

StatusOr<MapStore> MapStore::Open(const std::string& path, Access access) {
  OpenOptions options;
  options.access = access;
  return Open(path, options);
}

Status MapStore::CheckWritable(const std::string& path, bool dry_run) {
  if (!dry_run) SHIFTMAP_RETURN_IF_ERROR(Database::CheckWritable(path));
  StatusOr<Database> database = OpenStoreFile(path, {});
  // What else there is at the path, who opens it says.
  return database.ok() ? CheckNoSnapshot(*database) : OkStatus();
}

StatusOr<std::vector<AreaSummary>> MapStore::Areas() {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      state_->database.Prepare(
          "SELECT a.name, p.number, (SELECT count(*) FROM version v WHERE v.area_id = a.area_id "
          "AND v.content_stored) FROM area a LEFT JOIN version p "
          "ON p.version_id = a.published_version_id ORDER BY a.name"));
  std::vector<AreaSummary> areas;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return areas;
    AreaSummary area;
    area.area = query.Text(0);
    if (!query.IsNull(1)) area.published = VersionNumber(query.Int64(1));
    area.versions = static_cast<int>(query.Int64(2));
    areas.push_back(std::move(area));
  }
}

StatusOr<std::vector<VersionSummary>> MapStore::Versions(const std::string& area) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT v.number, p.number, v.content_hash, v.created_ns, v.tool, "
                       "v.stamp_ns, v.content_stored "
                       "FROM version v LEFT JOIN version p ON p.version_id = v.parent_version_id "
                       "WHERE v.area_id = ?1 ORDER BY v.number"));
  query.Bind(area_row.area_id);
  std::vector<VersionSummary> versions;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return versions;
    VersionSummary version;
    version.version = VersionNumber(query.Int64(0));
    if (!query.IsNull(1)) version.parent = VersionNumber(query.Int64(1));
    version.content_hash = query.Text(2);
    version.published = version.version == area_row.published;
    version.created = StampFromNanoseconds(query.Int64(3));
    version.tool = query.Text(4);
    version.stamp = StampFromNanoseconds(query.Int64(5));
    version.content_stored = query.Int64(6) != 0;
    versions.push_back(std::move(version));
  }
}

StatusOr<std::optional<VersionNumber>> MapStore::PublishedVersion(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<AreaRow> row, FindArea(state_->database, area));
  return row ? row->published : std::nullopt;
}

StatusOr<MapSnapshot> MapStore::LoadVersion(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  SHIFTMAP_ASSIGN_OR_RETURN(MapContent content,
                            ReadContent(database, row, state_->VersionName(area, version)));
  SHIFTMAP_ASSIGN_OR_RETURN(const LedgerPosition position, ReadLedgerPosition(database));
  SHIFTMAP_ASSIGN_OR_RETURN(auto aliases, state_->AliasesOf(area, row));
  return MapSnapshot(
      area, version, row.content_hash, std::move(content), position, std::move(aliases));
}

StatusOr<MapSnapshot> MapStore::LoadAt(const std::string& area,
                                       std::optional<VersionNumber> version,
                                       std::optional<Stamp> at) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  return state_->Load(area, version, {.at = at, .latest = state_->LatestStamp()});
}

StatusOr<MapSnapshot> MapStore::LoadKnown(const std::string& area,
                                          Stamp known,
                                          std::optional<VersionNumber> version,
                                          std::optional<Stamp> at) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_RETURN_IF_ERROR(state_->RefuseSnapshot("does not hold what was known before"));
  return state_->Load(
      area, version, {.at = at, .latest = state_->LatestStamp(known), .known = known});
}

StatusOr<std::vector<VehicleTrust>> MapStore::Trust(const std::string& area,
                                                    std::optional<VersionNumber> version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const State::Filtered filtered,
                            state_->Filter(area, version, {.latest = state_->LatestStamp()}));
  const std::map<std::int64_t, double>& broken = filtered.records.broken();
  SHIFTMAP_ASSIGN_OR_RETURN(Statement names,
                            database.Prepare("SELECT vehicle FROM shift_report UNION "
                                             "SELECT vehicle FROM run ORDER BY vehicle"));
  std::vector<VehicleTrust> trust;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool another, names.Step());
    if (!another) return trust;
    const auto found = broken.find(VehicleKey(names.Text(0)));
    if (found != broken.end()) trust.push_back({names.Text(0), found->second});
  }
}

StatusOr<Provenance> MapStore::LoadProvenance(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->RowOf(area, version));
  return ReadProvenance(database, row.version_id, state_->VersionName(area, version));
}

StatusOr<std::vector<LineRun>> MapStore::LineRuns(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->RowOf(area, version));
  return ReadLineRuns(database, row.version_id);
}

StatusOr<std::set<std::string>> MapStore::RunIdentities(const std::string& area,
                                                        VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->RowOf(area, version));
  return ReadRunIdentities(database, row.version_id);
}

StatusOr<std::vector<UnplacedRun>> MapStore::WaitingRuns(const std::string& area) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  std::set<std::string> known;
  if (area_row.published) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->PublishedRow(area, area_row));
    SHIFTMAP_ASSIGN_OR_RETURN(known, ReadRunIdentities(database, row.version_id));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const auto entries,
                            ReadAudit(database, area_row.area_id, {AuditAction::kWait}));
  std::vector<UnplacedRun> waiting;
  for (const AuditEntry& entry : entries) {
    const std::size_t blank = entry.subject.find(' ');
    if (blank == std::string::npos) continue;
    UnplacedRun run{entry.subject.substr(blank + 1), entry.subject.substr(0, blank), entry.written};
    if (known.insert(run.sha256).second) waiting.push_back(std::move(run));
  }
  return waiting;
}

StatusOr<std::vector<ReportSummary>> MapStore::Reports(const std::string& area,
                                                       std::optional<VersionNumber> version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->SelectRow(area, area_row, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent content,
                            ReadContent(database, row, state_->VersionName(area, row.number)));
  return SummarizeReports(database, area_row.area_id, row, content);
}

StatusOr<std::vector<EvidenceRow>> MapStore::Evidence(const std::string& area,
                                                      VersionNumber version,
                                                      const std::set<std::string>& without_runs) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->SelectRow(area, area_row, version));
  return ReadLineEvidence(database, area_row.area_id, row, without_runs);
}

StatusOr<std::vector<ModeVisibility>> MapStore::MappedVisibility(
    const std::string& area, VersionNumber version, const std::set<std::string>& without_runs) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row, state_->SelectRow(area, area_row, version));
  return ReadLineVisibility(database, area_row.area_id, row, without_runs);
}

StatusOr<std::vector<Exclusion>> MapStore::Exclusions(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  return ReadExclusions(state_->database, area_row.area_id);
}

StatusOr<std::vector<std::string>> MapStore::ExcludedRunsOf(const std::string& area,
                                                            VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            ReadExclusions(database, area_row.area_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<LineRun> runs,
                            ReadLineRuns(database, row.version_id));
  std::vector<std::string> names;
  for (const auto& [run, of, committed] : runs) {
    const Exclusion* const exclusion = FindExclusion(exclusions, run);
    if (exclusion != nullptr && !exclusion->held) names.push_back(run.name);
  }
  return names;
}

StatusOr<std::vector<AuditEntry>> MapStore::AuditLog(const std::optional<std::string>& area,
                                                     const std::vector<AuditAction>& only) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  if (!area) return ReadAudit(state_->database, std::nullopt, only);
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, *area));
  return ReadAudit(state_->database, area_row.area_id, only);
}

StatusOr<std::vector<UnmappedSighting>> MapStore::Sightings(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  return ReadSightings(state_->database, area_row.area_id);
}

}  // namespace shiftmap
