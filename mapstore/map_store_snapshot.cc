// SPDX-License-Identifier: Apache-2.0
//
// Snapshots: what a vehicle carries.
#include <chrono>
#include <filesystem>
#include <optional>
#include <thread>
#include <utility>

#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "mapstore/sqlite/place_database.h"
#include "mapstore/sqlite/temporary_database.h"
#include "mapstore/store/snapshot_file.h"
#include "mapstore/store/store_state.h"

namespace shiftmap {
namespace {

// How long the second reader of an export waits for a writer: one that is kept from beginning is
// waited for by the first.
constexpr std::chrono::milliseconds kWriterWait{5000};
constexpr std::chrono::milliseconds kReaderWait{50};
constexpr std::chrono::seconds kLongestExport{20};

// Reads a snapshot as a vehicle would, and compares.
// @param latest  The latest stamp that counted for `expected`.
Status VerifySnapshotFile(const std::string& path, Stamp latest, const MapSnapshot& expected) {
  MapStore::OpenOptions options;
  options.clock = [latest] { return latest; };
  options.clock_tolerance_s = 0.0;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, options));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot loaded, store.LoadAt(expected.area()));
  const std::string got = ContentHash(loaded.content());
  const std::string want = ContentHash(expected.content());
  if (got != want) {
    return DataLoss("map store '{}': snapshot reads back as {}, expected {}", path, got, want);
  }
  return OkStatus();
}

}  // namespace

StatusOr<std::string> MapStore::ExportSnapshot(const std::string& area, const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const ExportedSnapshot exported, ExportWithIdentity(area, path));
  return exported.sha256;
}

StatusOr<ExportedSnapshot> MapStore::ExportWithIdentity(const std::string& area,
                                                        const std::string& path) {
  const Database& database = state_->database;
  std::error_code error;
  if (std::filesystem::equivalent(path, database.path(), error)) {
    return InvalidArgument("{}: snapshot would replace the store itself", database.name());
  }
  // Where this may not write, a writer can come between its two readers: it would wait for the
  // first, and the second for the writer. So the second waits for a moment only, and the first then
  // lets the writer go on.
  const auto begin = std::chrono::steady_clock::now();
  for (;;) {
    StatusOr<ExportedSnapshot> exported = state_->Export(area, path);
    if (exported.status().code() != StatusCode::kAborted) return exported;
    if (std::chrono::steady_clock::now() - begin > kLongestExport) {
      return Unavailable("{}", Message(exported.status()));
    }
    std::this_thread::sleep_for(kReaderWait);
  }
}

StatusOr<ExportedSnapshot> MapStore::State::Export(const std::string& area,
                                                   const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const TemporaryDatabase temporary, TemporaryDatabase::Create(path));
  SHIFTMAP_ASSIGN_OR_RETURN(
      SnapshotWriter snapshot,
      SnapshotWriter::Open(
          database, temporary.path(), database.writable() ? kWriterWait : kReaderWait));
  // One time for all that follows.
  Stamp latest;
  std::optional<MapSnapshot> expected;
  VersionRow version;
  {
    // Keeps writers out until all rows are copied, and no longer: they wait for it. A writer that
    // waits for a reader lets no second one in, and the copy is read by a connection of its own: so
    // writers are kept from beginning, where this may write, and else nothing comes between the
    // two.
    SHIFTMAP_ASSIGN_OR_RETURN(const Transaction transaction,
                              database.writable() ? Write() : Read());
    SHIFTMAP_RETURN_IF_ERROR(database.QueryInt64("SELECT count(*) FROM area").status());
    SHIFTMAP_RETURN_IF_ERROR(snapshot.Begin());
    latest = LatestStamp();
    SHIFTMAP_ASSIGN_OR_RETURN(expected, Load(area, std::nullopt, {.latest = latest}));
    SHIFTMAP_ASSIGN_OR_RETURN(const AreaRow area_row, GetArea(database, area));
    SHIFTMAP_ASSIGN_OR_RETURN(version, PublishedRow(area, area_row));
    SnapshotWriter closed_after = std::move(snapshot);
    SHIFTMAP_RETURN_IF_ERROR(
        closed_after.Write(database, area_row.area_id, version, expected->content(), latest));
  }
  SHIFTMAP_RETURN_IF_ERROR(VerifySnapshotFile(temporary.path(), latest, *expected));
  SHIFTMAP_ASSIGN_OR_RETURN(std::string sha256, HashFile(temporary.path()));
  SHIFTMAP_RETURN_IF_ERROR(PlaceDatabase(temporary.path(), path));
  return ExportedSnapshot{
      std::move(sha256), version.number, version.content_hash, expected->ledger_position()};
}

}  // namespace shiftmap
