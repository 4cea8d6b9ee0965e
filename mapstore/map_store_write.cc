// SPDX-License-Identifier: Apache-2.0
//
// The writing half of MapStore: each function is one durable transaction.
#include <algorithm>
#include <set>
#include <string>
#include <utility>

#include "mapstore/map_store.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/audit_rows.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/checkpoint_upkeep.h"
#include "mapstore/store/edit_rows.h"
#include "mapstore/store/exclusion_rows.h"
#include "mapstore/store/mapped_rows.h"
#include "mapstore/store/provenance_rows.h"
#include "mapstore/store/report_rows.h"
#include "mapstore/store/store_state.h"

namespace shiftmap {
namespace {

StatusOr<AreaRow> FindOrInsertArea(Database& database, const std::string& area) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<AreaRow> found, FindArea(database, area));
  if (found) return *found;
  SHIFTMAP_ASSIGN_OR_RETURN(Statement insert,
                            database.Prepare(InsertRowSql("area", "name, published_version_id")));
  insert.Bind(area, std::optional<std::int64_t>());
  SHIFTMAP_RETURN_IF_ERROR(insert.Execute());
  return AreaRow{database.LastInsertRowId(), std::nullopt};
}

StatusOr<VersionNumber> NextVersionNumber(Database& database, std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT coalesce(max(number), 0) + 1 FROM version WHERE area_id = ?1"));
  query.Bind(area_id);
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  return VersionNumber(query.Int64(0));
}

// A store in which a line of versions does not go back in time is damaged: what is added to it
// would be too.
Status CheckParents(Database& database, std::int64_t area_id, const std::string& owner) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT v.number FROM version v LEFT JOIN version p "
                       "ON p.version_id = v.parent_version_id WHERE v.area_id = ?1 "
                       "AND v.parent_version_id IS NOT NULL "
                       "AND NOT coalesce(p.area_id = v.area_id AND p.number < v.number, 0) "
                       "ORDER BY v.number LIMIT 1"));
  query.Bind(area_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return OkStatus();
  return DataLoss(
      "{}: version {}: its parent is not an older version of the area", owner, query.Int64(0));
}

// The line of versions is in the order of time. A parent later than `latest` bounds nothing: the
// area would stay locked until then.
Status CheckOrder(Stamp stamp, Stamp parent, Stamp latest, const std::string& parent_name) {
  if (stamp >= parent || parent > latest) return OkStatus();
  return InvalidArgument("{}: the new version's stamp is {:.6f} s, before its parent's {:.6f} s",
                         parent_name,
                         ToSecondsSinceEpoch(stamp),
                         ToSecondsSinceEpoch(parent));
}

// What is said of a run counts once.
Status CheckNewRuns(Database& database, const VersionRow& parent, const Provenance& provenance) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::set<std::string> known,
                            ReadRunIdentities(database, parent.version_id));
  for (const RunRecord& run : provenance.runs) {
    if (!known.contains(run.sha256) && known.insert(run.identity()).second) continue;
    return InvalidArgument("{}: run '{}' is mapped already", database.name(), run.name);
  }
  return OkStatus();
}

// Evidence of older runs must be of runs that an ancestor mapped.
Status CheckOlderRuns(Database& database,
                      const std::optional<std::int64_t>& parent_version_id,
                      const Provenance& provenance) {
  if (provenance.older.empty()) return OkStatus();
  std::set<std::string> known;
  if (parent_version_id) {
    SHIFTMAP_ASSIGN_OR_RETURN(known, ReadRunIdentities(database, *parent_version_id));
  }
  for (const RunRecord& run : provenance.older) {
    if (known.contains(run.sha256)) continue;
    return InvalidArgument("{}: run '{}' is of no ancestor", database.name(), run.name);
  }
  return OkStatus();
}

bool HasEvidence(const Provenance& provenance) {
  const auto has_evidence = [](const RunRecord& run) { return !run.evidence.empty(); };
  return std::any_of(provenance.runs.begin(), provenance.runs.end(), has_evidence) ||
         std::any_of(provenance.older.begin(), provenance.older.end(), has_evidence);
}

Status InsertWaiting(Database& database,
                     std::int64_t area_id,
                     const std::vector<UnplacedRun>& runs) {
  for (const UnplacedRun& run : runs) {
    SHIFTMAP_RETURN_IF_ERROR(
        InsertAudit(database, area_id, AuditAction::kWait, run.sha256 + " " + run.name));
  }
  return OkStatus();
}

AuditAction ActionOf(NightNote note) {
  switch (note) {
    case NightNote::kRefused:
      return AuditAction::kRefuse;
    case NightNote::kLocated:
      return AuditAction::kLocate;
    case NightNote::kLeftOut:
      return AuditAction::kLeave;
  }
  return AuditAction::kRefuse;
}

// As an audit entry and a message name it.
std::string SubjectOf(const Exclusion& exclusion) {
  return exclusion.vehicle.empty() ? fmt::format("run {}", exclusion.run)
                                   : fmt::format("vehicle '{}'", exclusion.vehicle);
}

}  // namespace

StatusOr<VersionRow> MapStore::State::AddVersion(std::int64_t area_id,
                                                 const MapContent& content,
                                                 const Provenance& provenance,
                                                 bool states_probabilities,
                                                 VersionRow version) {
  SHIFTMAP_ASSIGN_OR_RETURN(version.number, NextVersionNumber(database, area_id));
  SHIFTMAP_ASSIGN_OR_RETURN(
      version,
      InsertVersion(
          database, area_id, std::move(version), states_probabilities, content, provenance));
  SHIFTMAP_RETURN_IF_ERROR(InsertRuns(database, area_id, version.version_id, provenance.runs));
  SHIFTMAP_RETURN_IF_ERROR(
      InsertOlderEvidence(database, area_id, version.version_id, provenance.older));
  SHIFTMAP_RETURN_IF_ERROR(InsertMappedReports(database, version.version_id));
  SHIFTMAP_RETURN_IF_ERROR(
      InsertAudit(database, area_id, AuditAction::kCommit, std::to_string(version.number.value())));
  return version;
}

Status MapStore::State::MovePublished(std::int64_t area_id,
                                      const VersionRow& version,
                                      AuditAction action) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement update,
      database.Prepare("UPDATE area SET published_version_id = ?2 WHERE area_id = ?1"));
  update.Bind(area_id, version.version_id);
  SHIFTMAP_RETURN_IF_ERROR(update.Execute());
  SHIFTMAP_RETURN_IF_ERROR(SetChecksums(database, "area", fmt::format("area_id = {}", area_id)));
  return InsertAudit(database, area_id, action, std::to_string(version.number.value()), clock());
}

// What was written is durable, and whoever reads will see an error of the ledger.
void MapStore::State::MakeCheckpoints(const std::string& area,
                                      std::int64_t area_id,
                                      const VersionRow& version) {
  ExtendCheckpoints(
      database, area_id, version.version_id, checkpoint_rows, VersionName(area, version.number))
      .IgnoreError();
}

StatusOr<ModeNumbers*> MapStore::State::NumbersOf(const VersionRow& version) {
  if (!numbers || numbers->version_id() != version.version_id) {
    SHIFTMAP_ASSIGN_OR_RETURN(numbers, ModeNumbers::Make(database, version.version_id));
  }
  return &*numbers;
}

StatusOr<CommitResult> MapStore::Commit(const std::string& area,
                                        const MapContent& content,
                                        const Provenance& provenance,
                                        const CommitOptions& options) {
  Database& database = state_->database;
  if (area.empty()) return InvalidArgument("{}: area name is empty", database.name());
  const Status valid = ValidateMapContent(content);
  if (!valid.ok()) return InvalidArgument("{}: {}", state_->AreaName(area), Message(valid));
  SHIFTMAP_RETURN_IF_ERROR(CheckNotInFuture(fmt::format("{}: version", state_->AreaName(area)),
                                            content.stamp,
                                            state_->clock(),
                                            state_->clock_tolerance_s));
  if (options.states_probabilities && HasEvidence(provenance)) {
    return InvalidArgument("{}: evidence of runs beside a statement", state_->AreaName(area));
  }
  for (const std::vector<RunRecord>* const runs : {&provenance.runs, &provenance.older}) {
    if (const Status fits = CheckRunEvidence(*runs, content); !fits.ok()) {
      return InvalidArgument("{}: {}", state_->AreaName(area), Message(fits));
    }
  }
  VersionRow version;
  version.content_hash =
      options.states_probabilities ? ContentHash(content) : GeometryHash(content);
  version.stamp = content.stamp;
  version.created = state_->clock();

  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, FindOrInsertArea(database, area));
  SHIFTMAP_RETURN_IF_ERROR(CheckParents(database, area_row.area_id, state_->AreaName(area)));
  if (options.parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow parent,
                              GetVersion(database, area, area_row.area_id, *options.parent));
    version.parent_version_id = parent.version_id;
    version.statement_version_id = parent.statement_version_id;
    if (!options.states_probabilities) {
      SHIFTMAP_RETURN_IF_ERROR(CheckNewRuns(database, parent, provenance));
    }
    SHIFTMAP_RETURN_IF_ERROR(CheckOrder(content.stamp,
                                        parent.stamp,
                                        state_->LatestStamp(),
                                        state_->VersionName(area, parent.number)));
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckOlderRuns(database, version.parent_version_id, provenance));
  const std::optional<VersionNumber> expected =
      options.expected ? options.expected : options.parent;
  const bool compare = expected || !options.replace;
  if (options.publish && compare && area_row.published != expected) {
    return MakeStatus(StatusCode::kAborted,
                      "{}: {} is published, expected {}",
                      state_->AreaName(area),
                      DescribeVersion(area_row.published),
                      DescribeVersion(expected));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions,
                            ReadExclusions(database, area_row.area_id));
  for (const RunRecord& run : provenance.runs) {
    const Exclusion* const exclusion = FindExclusion(exclusions, run);
    if (exclusion == nullptr) continue;
    return MakeStatus(StatusCode::kAborted,
                      "{}: run '{}' was {} since the build began: {}",
                      state_->AreaName(area),
                      run.name,
                      exclusion->held ? "held" : "excluded",
                      exclusion->reason);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(version.ledger_position, ReadLedgerPosition(database));
  if (options.ledger_position) {
    version.ledger_position = std::min(version.ledger_position, *options.ledger_position);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      version,
      state_->AddVersion(
          area_row.area_id, content, provenance, options.states_probabilities, std::move(version)));
  for (const EditId edit : options.without_edits) {
    SHIFTMAP_RETURN_IF_ERROR(InsertVersionEdit(database, version.version_id, edit, false));
  }
  if (options.publish) {
    SHIFTMAP_RETURN_IF_ERROR(
        state_->MovePublished(area_row.area_id, version, AuditAction::kPublish));
  }
  SHIFTMAP_RETURN_IF_ERROR(InsertWaiting(database, area_row.area_id, options.waiting));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  if (options.publish) state_->MakeCheckpoints(area, area_row.area_id, version);
  return CommitResult{version.number, version.content_hash};
}

Status MapStore::NoteWaiting(const std::string& area, const std::vector<UnplacedRun>& runs) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, area));
  SHIFTMAP_RETURN_IF_ERROR(InsertWaiting(state_->database, area_row.area_id, runs));
  return transaction.Commit();
}

Status MapStore::AddNote(const std::optional<std::string>& area,
                         NightNote note,
                         const std::string& subject) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Write());
  std::optional<std::int64_t> area_id;
  if (area) {
    SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(state_->database, *area));
    area_id = area_row.area_id;
  }
  SHIFTMAP_RETURN_IF_ERROR(
      InsertAudit(state_->database, area_id, ActionOf(note), subject, state_->clock()));
  return transaction.Commit();
}

Status MapStore::Publish(const std::string& area,
                         VersionNumber version,
                         std::optional<VersionNumber> expected,
                         bool dry_run) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Change(dry_run));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow row,
                            GetVersion(database, area, area_row.area_id, version));
  const std::string owner = state_->VersionName(area, version);
  if (area_row.published == version) {
    return MakeStatus(StatusCode::kAlreadyExists, "{}: is published already", owner);
  }
  if (area_row.published != expected) {
    return MakeStatus(StatusCode::kAborted,
                      "{}: {} is published, expected {}",
                      state_->AreaName(area),
                      DescribeVersion(area_row.published),
                      DescribeVersion(expected));
  }
  if (!row.content_stored) return FailedPrecondition("{}: its content was compacted away", owner);
  if (dry_run) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(state_->MovePublished(area_row.area_id, row, AuditAction::kPublish));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  state_->MakeCheckpoints(area, area_row.area_id, row);
  return OkStatus();
}

StatusOr<VersionNumber> MapStore::Rollback(const std::string& area,
                                           std::optional<VersionNumber> to,
                                           bool dry_run) {
  Database& database = state_->database;
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, state_->Change(dry_run));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(const VersionRow published, state_->PublishedRow(area, area_row));
  if (to) SHIFTMAP_RETURN_IF_ERROR(GetVersion(database, area, area_row.area_id, *to).status());
  VersionRow at = published;
  do {
    if (!at.parent_version_id) {
      return InvalidArgument(
          "{}: has no ancestor{}; shiftmap-inspect publish N --expected {} takes another version",
          state_->VersionName(area, published.number),
          to ? fmt::format(" {}", to->value()) : "",
          published.number.value());
    }
    SHIFTMAP_ASSIGN_OR_RETURN(at, GetVersionById(database, *at.parent_version_id));
  } while (to && at.number > *to);
  const std::string owner = state_->VersionName(area, at.number);
  if (to && at.number != *to) {
    return InvalidArgument("{}: is no ancestor of version {}, which is published",
                           state_->VersionName(area, *to),
                           published.number.value());
  }
  if (!at.content_stored) return FailedPrecondition("{}: its content was compacted away", owner);
  if (dry_run) return at.number;
  SHIFTMAP_RETURN_IF_ERROR(state_->MovePublished(area_row.area_id, at, AuditAction::kRollback));
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  state_->MakeCheckpoints(area, area_row.area_id, at);
  return at.number;
}

Status MapStore::State::AuditExclusion(std::int64_t area_id,
                                       const Exclusion& exclusion,
                                       bool included) {
  const AuditAction action = included         ? AuditAction::kInclude
                             : exclusion.held ? AuditAction::kHold
                                              : AuditAction::kExclude;
  const std::string subject = SubjectOf(exclusion);
  return InsertAudit(
      database,
      area_id,
      action,
      exclusion.reason.empty() ? subject : fmt::format("{}: {}", subject, exclusion.reason));
}

StatusOr<Exclusion> MapStore::State::AddOne(const std::string& area,
                                            const Exclusion& exclusion,
                                            std::vector<Exclusion>* holding) const {
  if (exclusion.reason.empty()) return InvalidArgument("{}: expected a reason", AreaName(area));
  if (const Exclusion* const added = AddExclusion(exclusion, holding)) return *added;
  return MakeStatus(StatusCode::kAlreadyExists,
                    "{}: {}: is {} already",
                    AreaName(area),
                    SubjectOf(exclusion),
                    exclusion.held ? "excluded or held" : "excluded");
}

StatusOr<std::vector<Exclusion>> MapStore::State::EndOne(const std::string& area,
                                                         const AreaRow& area_row,
                                                         const Exclusion& exclusion,
                                                         std::vector<Exclusion>* holding) {
  std::set<std::string> names{exclusion.run};
  if (!exclusion.run.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(names, NamesOfRun(database, area_row.area_id, exclusion.run));
  }
  const auto others_end =
      std::stable_partition(holding->begin(), holding->end(), [&](const Exclusion& other) {
        return other.vehicle != exclusion.vehicle || !names.contains(other.run);
      });
  std::vector<Exclusion> ended(others_end, holding->end());
  holding->erase(others_end, holding->end());
  if (!ended.empty()) return ended;
  std::optional<std::string> vehicle;
  if (!exclusion.run.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        vehicle, ExcludedVehicleOf(database, area_row.area_id, exclusion.run, *holding));
  }
  return vehicle
             ? NotFound("{}: {}: only its vehicle is excluded or held, '{}'",
                        AreaName(area),
                        SubjectOf(exclusion),
                        *vehicle)
             : NotFound(
                   "{}: {}: is neither excluded nor held", AreaName(area), SubjectOf(exclusion));
}

Status MapStore::State::ChangeExclusions(const std::string& area,
                                         std::vector<Exclusion> exclusions,
                                         bool exclude,
                                         bool dry_run) {
  SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction, Change(dry_run));
  SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<Exclusion> holding,
                            ReadExclusions(database, area_row.area_id));
  const Stamp now = clock();
  for (Exclusion& exclusion : exclusions) {
    if (exclusion.run.empty() == exclusion.vehicle.empty()) {
      return InvalidArgument("{}: expected either a run or a vehicle to exclude", AreaName(area));
    }
    if (!exclusion.run.empty()) {
      SHIFTMAP_ASSIGN_OR_RETURN(exclusion.run, FindRun(database, area_row.area_id, exclusion.run));
    }
    exclusion.excluded = now;
    std::vector<Exclusion> ended;
    std::optional<Exclusion> added;
    if (exclude) {
      SHIFTMAP_ASSIGN_OR_RETURN(added, AddOne(area, exclusion, &holding));
    } else {
      SHIFTMAP_ASSIGN_OR_RETURN(ended, EndOne(area, area_row, exclusion, &holding));
    }
    if (dry_run) continue;
    if (added) SHIFTMAP_RETURN_IF_ERROR(WriteExclusion(database, area_row.area_id, *added));
    for (const Exclusion& one : ended) {
      SHIFTMAP_RETURN_IF_ERROR(EndExclusion(database, area_row.area_id, one, now).status());
    }
    SHIFTMAP_RETURN_IF_ERROR(AuditExclusion(area_row.area_id, exclusion, !exclude));
  }
  if (dry_run) return OkStatus();
  SHIFTMAP_RETURN_IF_ERROR(
      DeleteCheckpointsAfter(database, area_row.area_id, Stamp::min()).status());
  std::optional<VersionRow> published;
  if (area_row.published) {
    SHIFTMAP_ASSIGN_OR_RETURN(published, PublishedRow(area, area_row));
  }
  SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  if (published) MakeCheckpoints(area, area_row.area_id, *published);
  return OkStatus();
}

Status MapStore::Exclude(const std::string& area, Exclusion exclusion, bool dry_run) {
  return ExcludeAll(area, {std::move(exclusion)}, dry_run);
}

Status MapStore::ExcludeAll(const std::string& area,
                            std::vector<Exclusion> exclusions,
                            bool dry_run) {
  return state_->ChangeExclusions(area, std::move(exclusions), true, dry_run);
}

Status MapStore::IncludeAll(const std::string& area,
                            std::vector<Exclusion> exclusions,
                            bool dry_run) {
  return state_->ChangeExclusions(area, std::move(exclusions), false, dry_run);
}

}  // namespace shiftmap
