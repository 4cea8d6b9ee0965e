// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map_store.h"

#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <unordered_map>
#include <utility>

#include "mapstore/core/atomic_file.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/map/sha256.h"
#include "mapstore/schema/store_file.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/sqlite/transaction.h"
#include "mapstore/store/ledger_rows.h"
#include "mapstore/store/provenance_rows.h"
#include "mapstore/store/snapshot_file.h"
#include "mapstore/store/version_rows.h"

namespace shiftmap {
namespace {

std::string DescribeVersion(const std::optional<VersionNumber>& version) {
  return version ? fmt::format("version {}", version->value()) : "no version";
}

// Replaces the probabilities of `content` by what the ledger implies, and its stamp by the time at
// which they hold.
Status ApplyLedger(Database& database,
                   std::int64_t area_id,
                   const std::vector<VersionRow>& lineage,
                   std::optional<Stamp> at,
                   MapContent& content) {
  std::unordered_map<Signature, std::size_t> group_index;
  std::vector<ModeState> states;
  for (const LandmarkGroup& group : content.groups) {
    group_index.emplace(group.signature, states.size());
    states.push_back({group.probabilities, content.stamp});
  }
  std::optional<Stamp> newest;
  SHIFTMAP_RETURN_IF_ERROR(
      ForEachLandmark(database,
                      area_id,
                      lineage,
                      at,
                      [&](const Signature& signature, std::vector<EvidenceRow> rows) {
                        Stamp oldest = content.stamp;
                        for (const EvidenceRow& row : rows) {
                          oldest = std::min(oldest, row.evidence.begin);
                          newest = std::max(newest.value_or(row.evidence.end), row.evidence.end);
                        }
                        const auto found = group_index.find(signature);
                        if (found == group_index.end()) return;
                        const LandmarkGroup& group = content.groups[found->second];
                        // Evidence older than the map meets the map's distribution as it is; from
                        // there on time passes.
                        states[found->second] = FilterModes(group, oldest, std::move(rows));
                      }));
  content.stamp =
      newest ? at.value_or(*newest) : std::max(content.stamp, at.value_or(content.stamp));
  for (std::size_t i = 0; i < states.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    group.probabilities = PropagateModes(group, states[i], content.stamp);
  }
  return OkStatus();
}

// A file that is removed at its end, with the journal that SQLite may leave beside it.
class TemporaryFile {
 public:
  explicit TemporaryFile(std::string path) : path_(std::move(path)) { Remove(); }
  ~TemporaryFile() { Remove(); }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  void Remove() {
    std::error_code error;
    std::filesystem::remove(path_, error);
    std::filesystem::remove(path_ + "-journal", error);
  }

  std::string path_;
};

// Reads a snapshot as a vehicle would, and compares.
Status VerifySnapshotFile(const std::string& path, const MapSnapshot& expected) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot loaded, store.LoadAt(expected.area()));
  const std::string got = ContentHash(loaded.content());
  const std::string want = ContentHash(expected.content());
  if (got != want) {
    return DataLoss("map store '{}': snapshot reads back as {}, expected {}", path, got, want);
  }
  return OkStatus();
}

}  // namespace

struct MapStore::State {
  Database database;

  std::string AreaName(const std::string& area) const {
    return fmt::format("{}: area '{}'", database.name(), area);
  }

  std::string VersionName(const std::string& area, VersionNumber version) const {
    return fmt::format("{}: area '{}': version {}", database.name(), area, version.value());
  }

  StatusOr<Transaction> Read() { return Transaction::Begin(database, Transaction::Kind::kRead); }

  StatusOr<Transaction> Write() { return Transaction::Begin(database, Transaction::Kind::kWrite); }

  StatusOr<VersionRow> PublishedRow(const std::string& area, const AreaRow& area_row) {
    if (!area_row.published) return NotFound("{}: nothing is published", AreaName(area));
    return GetVersion(database, area, area_row.area_id, *area_row.published);
  }

  // LoadAt inside a transaction.
  StatusOr<MapSnapshot> Load(const std::string& area,
                             std::optional<VersionNumber> version,
                             std::optional<Stamp> at) {
    SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                              version ? GetVersion(database, area, area_row.area_id, *version)
                                      : PublishedRow(area, area_row));
    SHIFTMAP_ASSIGN_OR_RETURN(MapContent content,
                              ReadContent(database, row, VersionName(area, row.number)));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionRow> lineage,
                              Lineage(database, row.version_id));
    SHIFTMAP_RETURN_IF_ERROR(ApplyLedger(database, area_row.area_id, lineage, at, content));
    return MapSnapshot(area, row.number, row.content_hash, std::move(content));
  }

  StatusOr<AreaRow> FindOrInsertArea(const std::string& area) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<AreaRow> found, FindArea(database, area));
    if (found) return *found;
    SHIFTMAP_ASSIGN_OR_RETURN(Statement insert,
                              database.Prepare("INSERT INTO area (name) VALUES (?1)"));
    insert.Bind(area);
    SHIFTMAP_RETURN_IF_ERROR(insert.Execute());
    return AreaRow{database.LastInsertRowId(), std::nullopt};
  }

  StatusOr<VersionNumber> NextVersionNumber(std::int64_t area_id) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement query,
        database.Prepare("SELECT coalesce(max(number), 0) + 1 FROM version WHERE area_id = ?1"));
    query.Bind(area_id);
    SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
    return VersionNumber(query.Int64(0));
  }

  Status Publish(std::int64_t area_id, std::int64_t version_id, VersionNumber number) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        Statement update,
        database.Prepare("UPDATE area SET published_version_id = ?2 WHERE area_id = ?1"));
    update.Bind(area_id, version_id);
    SHIFTMAP_RETURN_IF_ERROR(update.Execute());
    return InsertAudit(database, area_id, "publish", std::to_string(number.value()));
  }
};

MapStore::MapStore(std::unique_ptr<State> state) : state_(std::move(state)) {}
MapStore::MapStore(MapStore&&) noexcept = default;
MapStore& MapStore::operator=(MapStore&&) noexcept = default;
MapStore::~MapStore() = default;

StatusOr<MapStore> MapStore::Open(const std::string& path, Access access) {
  Database::Options options;
  switch (access) {
    case Access::kReadOnly:
      options.mode = Database::Mode::kReadOnly;
      break;
    case Access::kReadWrite:
      options.mode = Database::Mode::kReadWrite;
      break;
    case Access::kReadWriteCreate:
      options.mode = Database::Mode::kReadWriteCreate;
      break;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(Database database, OpenStoreFile(path, options));
  return MapStore(std::make_unique<State>(State{std::move(database)}));
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
      database.Prepare("SELECT v.number, p.number, v.content_hash, v.created_ns, v.tool "
                       "FROM version v LEFT JOIN version p ON p.version_id = v.parent_version_id "
                       "WHERE v.area_id = ?1 AND v.content_stored ORDER BY v.number"));
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
    versions.push_back(std::move(version));
  }
}

StatusOr<std::optional<VersionNumber>> MapStore::PublishedVersion(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<AreaRow> row, FindArea(state_->database, area));
  return row ? row->published : std::nullopt;
}

StatusOr<CommitResult> MapStore::Commit(const std::string& area,
                                        const MapContent& content,
                                        const Provenance& provenance,
                                        const CommitOptions& options) {
  Database& database = state_->database;
  if (area.empty()) return InvalidArgument("{}: area name is empty", database.name());
  const Status valid = ValidateMapContent(content);
  if (!valid.ok()) return InvalidArgument("{}: {}", state_->AreaName(area), Message(valid));
  CommitResult result;
  result.content_hash = ContentHash(content);

  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, state_->FindOrInsertArea(area));
  std::optional<std::int64_t> parent_id;
  if (options.parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow parent,
                              GetVersion(database, area, area_row.area_id, *options.parent));
    parent_id = parent.version_id;
    if (options.publish && area_row.published != options.parent) {
      return MakeStatus(StatusCode::kAborted,
                        "{}: {} is published, expected {}",
                        state_->AreaName(area),
                        DescribeVersion(area_row.published),
                        DescribeVersion(options.parent));
    }
  }
  SHIFTMAP_ASSIGN_OR_RETURN(result.version, state_->NextVersionNumber(area_row.area_id));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t version_id,
                            InsertVersion(database,
                                          area_row.area_id,
                                          result.version,
                                          parent_id,
                                          result.content_hash,
                                          content,
                                          provenance));
  SHIFTMAP_RETURN_IF_ERROR(InsertRuns(database, version_id, provenance.runs));
  SHIFTMAP_RETURN_IF_ERROR(
      InsertAudit(database, area_row.area_id, "commit", std::to_string(result.version.value())));
  if (options.publish) {
    SHIFTMAP_RETURN_IF_ERROR(state_->Publish(area_row.area_id, version_id, result.version));
  }
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  return result;
}

StatusOr<MapSnapshot> MapStore::LoadVersion(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  SHIFTMAP_ASSIGN_OR_RETURN(MapContent content,
                            ReadContent(database, row, state_->VersionName(area, version)));
  return MapSnapshot(area, version, row.content_hash, std::move(content));
}

StatusOr<MapSnapshot> MapStore::LoadAt(const std::string& area,
                                       std::optional<VersionNumber> version,
                                       std::optional<Stamp> at) {
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  return state_->Load(area, version, at);
}

StatusOr<Provenance> MapStore::LoadProvenance(const std::string& area, VersionNumber version) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  return ReadProvenance(database, row.version_id, state_->VersionName(area, version));
}

StatusOr<ReturnResult> MapStore::Return(const ShiftReport& report) {
  Database& database = state_->database;
  const Status valid = CheckReport(report);
  if (!valid.ok()) return InvalidArgument("{}: {}", database.name(), Message(valid));

  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  ReturnResult result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.duplicate, HasReport(database, report.uuid));
  if (result.duplicate) return result;
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, report.area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version,
                            GetVersion(database, report.area, area_row.area_id, report.version));
  if (report.content_hash != version.content_hash) {
    return InvalidArgument("{}: shift report {}: content hash {}, expected {}",
                           state_->VersionName(report.area, report.version),
                           report.uuid,
                           report.content_hash,
                           version.content_hash);
  }
  std::optional<std::int64_t> published_id;
  if (area_row.published) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow published,
                              state_->PublishedRow(report.area, area_row));
    published_id = published.version_id;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(result.rows_set_aside,
                            CountUnknownModes(database, published_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertReport(database, area_row.area_id, version.version_id, report));
  SHIFTMAP_RETURN_IF_ERROR(InsertAudit(database, area_row.area_id, "return", report.uuid));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  result.evidence_rows = static_cast<int>(report.evidence.size());
  return result;
}

StatusOr<std::vector<UnmappedSighting>> MapStore::Sightings(const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  return ReadSightings(state_->database, area_row.area_id);
}

StatusOr<std::string> MapStore::ExportSnapshot(const std::string& area, const std::string& path) {
  Database& database = state_->database;
  std::error_code error;
  if (std::filesystem::equivalent(path, database.path(), error)) {
    return InvalidArgument("{}: snapshot would replace the store itself", database.name());
  }
  const TemporaryFile temporary(fmt::format("{}.tmp-{}", path, getpid()));
  // Keeps writers out until all rows are copied and compared.
  SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction, state_->Read());
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot expected,
                            state_->Load(area, std::nullopt, std::nullopt));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow version, state_->PublishedRow(area, area_row));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionRow> lineage,
                            Lineage(database, version.version_id));
  SHIFTMAP_RETURN_IF_ERROR(
      WriteSnapshotFile(database, area_row.area_id, lineage, temporary.path()));
  SHIFTMAP_RETURN_IF_ERROR(VerifySnapshotFile(temporary.path(), expected));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string sha256, HashFile(temporary.path()));
  SHIFTMAP_RETURN_IF_ERROR(SyncAndRename(temporary.path(), path));
  return sha256;
}

}  // namespace shiftmap
