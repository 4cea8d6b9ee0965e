// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/checkpoint_upkeep.h"

#include <algorithm>
#include <optional>

#include "mapstore/sqlite/transaction.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/ledger_filter.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kRowsPerGroup = 2;

// A new version filters years of rows: its checkpoints are dense only at the end, where they are
// asked for.
constexpr std::int64_t kCheckpointsOfRest = 8;

// Some tenths of a second: nobody waits for longer.
constexpr std::int64_t kMaxRowsPerStep = 200'000;

// Others may write each time.
constexpr int kAttempts = 3;

// Rows between the checkpoints of a version, and from its newest one to the end.
StatusOr<std::int64_t> Spacing(Database& database,
                               std::int64_t version_id,
                               std::int64_t checkpoint_rows) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT count(*) FROM landmark_group WHERE version_id = ?1"));
  query.Bind(version_id);
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  return std::max(checkpoint_rows, kRowsPerGroup * query.Int64(0));
}

StatusOr<std::int64_t> AddRowsSinceCheckpoint(Database& database,
                                              std::int64_t area_id,
                                              std::int64_t rows) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement update,
      database.Prepare("UPDATE area SET rows_since_checkpoint = rows_since_checkpoint + ?2 "
                       "WHERE area_id = ?1"));
  update.Bind(area_id, rows);
  SHIFTMAP_RETURN_IF_ERROR(update.Execute());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT rows_since_checkpoint FROM area WHERE area_id = ?1"));
  query.Bind(area_id);
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  return query.Int64(0);
}

// Rows of visits that begin at `from` or later.
StatusOr<std::int64_t> CountRows(Database& database, std::int64_t area_id, Stamp from) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT (SELECT count(*) FROM visit_evidence WHERE area_id = ?1 "
                       "AND begin_ns >= ?2) + (SELECT count(*) FROM mapped_evidence "
                       "WHERE area_id = ?1 AND begin_ns >= ?2)"));
  query.Bind(area_id, ToNanoseconds(from));
  SHIFTMAP_RETURN_IF_ERROR(query.Step().status());
  return query.Int64(0);
}

// Begin of the row that comes `rows` after the first one that begins at `from` or later.
StatusOr<std::optional<Stamp>> BeginAfter(Database& database,
                                          std::int64_t area_id,
                                          Stamp from,
                                          std::int64_t rows) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT begin_ns FROM visit_evidence WHERE area_id = ?1 AND begin_ns >= ?2 "
                       "UNION ALL SELECT begin_ns FROM mapped_evidence WHERE area_id = ?1 "
                       "AND begin_ns >= ?2 ORDER BY begin_ns LIMIT 1 OFFSET ?3"));
  query.Bind(area_id, ToNanoseconds(from), rows);
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
  if (!found) return std::optional<Stamp>();
  return std::optional<Stamp>(StampFromNanoseconds(query.Int64(0)));
}

// Advances to where the next checkpoint is due. False if none is.
// @param left  Rows after filter->before().
StatusOr<bool> AdvanceToNext(Database& database,
                             std::int64_t area_id,
                             std::int64_t spacing,
                             LedgerFilter* filter,
                             std::int64_t* left) {
  while (*left > spacing) {
    const std::int64_t step =
        std::clamp(*left / kCheckpointsOfRest, spacing, std::max(spacing, kMaxRowsPerStep));
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::optional<Stamp> next,
        BeginAfter(database, area_id, filter->before(), std::min(step, *left - spacing)));
    if (!next) return false;
    // Visits that begin together stay together.
    const Stamp before = std::max(*next, filter->before() + Duration(1));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t taken, filter->AdvanceTo(before));
    *left -= taken;
    if (taken > 0) return true;
  }
  return false;
}

Status Insert(Database& database,
              std::int64_t area_id,
              const VersionRow& version,
              const LedgerFilter& filter) {
  return InsertCheckpoint(
      database, area_id, version.version_id, {filter.before(), true, filter.states()});
}

// False if somebody else wrote meanwhile.
StatusOr<bool> TryToExtend(Database& database,
                           std::int64_t area_id,
                           std::int64_t version_id,
                           std::int64_t checkpoint_rows,
                           const std::string& owner) {
  const auto writes_of_others = [&] { return database.QueryInt64("PRAGMA data_version"); };
  std::int64_t known_writes = 0;
  std::int64_t spacing = 0;
  std::int64_t left = 0;
  VersionRow version;
  MapContent content;
  std::optional<LedgerFilter> filter;
  for (bool more = true; more;) {
    {
      SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction,
                                Transaction::Begin(database, Transaction::Kind::kRead));
      SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t writes, writes_of_others());
      if (!filter) {
        known_writes = writes;
        SHIFTMAP_ASSIGN_OR_RETURN(version, GetVersionById(database, version_id));
        SHIFTMAP_ASSIGN_OR_RETURN(content, ReadContent(database, version, owner));
        SHIFTMAP_ASSIGN_OR_RETURN(spacing, Spacing(database, version_id, checkpoint_rows));
        filter.emplace(database, area_id, version, content);
        SHIFTMAP_RETURN_IF_ERROR(filter->Start(std::nullopt));
        SHIFTMAP_ASSIGN_OR_RETURN(left, CountRows(database, area_id, filter->before()));
      }
      if (writes != known_writes) return false;
      SHIFTMAP_ASSIGN_OR_RETURN(more, AdvanceToNext(database, area_id, spacing, &*filter, &left));
    }
    if (!more) break;
    SHIFTMAP_ASSIGN_OR_RETURN(Transaction transaction,
                              Transaction::Begin(database, Transaction::Kind::kWrite));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t writes, writes_of_others());
    if (writes != known_writes) return false;
    SHIFTMAP_RETURN_IF_ERROR(Insert(database, area_id, version, *filter));
    SHIFTMAP_RETURN_IF_ERROR(transaction.Commit());
  }
  return true;
}

}  // namespace

Status KeepCheckpoints(Database& database,
                       std::int64_t area_id,
                       const InsertedReport& inserted,
                       std::int64_t rows_added,
                       const std::optional<VersionRow>& published,
                       std::int64_t checkpoint_rows,
                       const std::string& owner) {
  int deleted = 0;
  if (inserted.changed_from) {
    SHIFTMAP_ASSIGN_OR_RETURN(deleted,
                              DeleteCheckpointsAfter(database, area_id, *inserted.changed_from));
  }
  if (!published) {
    return AddRowsSinceCheckpoint(database, area_id, rows_added).status();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t spacing,
                            Spacing(database, published->version_id, checkpoint_rows));
  // What was deleted is not made again at once: the next report may delete it again.
  const std::int64_t due = rows_added + (deleted > 0 ? spacing / 2 : 0);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t rows,
                            AddRowsSinceCheckpoint(database, area_id, due));
  if (rows <= spacing) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const MapContent content, ReadContent(database, *published, owner));
  LedgerFilter filter(database, area_id, *published, content);
  SHIFTMAP_RETURN_IF_ERROR(filter.Start(std::nullopt));
  SHIFTMAP_ASSIGN_OR_RETURN(std::int64_t left, CountRows(database, area_id, filter.before()));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool due_now,
                            AdvanceToNext(database, area_id, spacing, &filter, &left));
  if (due_now) SHIFTMAP_RETURN_IF_ERROR(Insert(database, area_id, *published, filter));
  // The next report goes on where this one stops.
  if (left > spacing) return OkStatus();
  return AddRowsSinceCheckpoint(database, area_id, -rows).status();
}

Status ExtendCheckpoints(Database& database,
                         std::int64_t area_id,
                         std::int64_t version_id,
                         std::int64_t checkpoint_rows,
                         const std::string& owner) {
  for (int attempt = 0; attempt < kAttempts; ++attempt) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool done,
                              TryToExtend(database, area_id, version_id, checkpoint_rows, owner));
    if (done) break;
  }
  return OkStatus();
}

}  // namespace shiftmap
