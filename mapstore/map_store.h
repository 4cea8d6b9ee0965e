// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/trajectory.h"
#include "proto/core/status.h"

namespace shiftmap {

/// One pose of a run's trajectory as the mapper estimated it.
using TrajectoryPose = StampedPose;

/// A run that a version was built from.
struct RunRecord {
  std::string name;    ///< The log file's stem.
  std::string sha256;  ///< Of the log file, in hex.
  std::string vehicle;
  Stamp begin;
  Stamp end;
  std::vector<TrajectoryPose> trajectory;  ///< Thinned for pictures; may be empty.
};

/// Where a version comes from.
struct Provenance {
  std::string tool;           ///< E.g. "shiftmap-mapper 0.1.0".
  std::string configuration;  ///< Effective options, JSON.
  std::int64_t seed = 0;
  std::vector<RunRecord> runs;  ///< By begin, then hash.
};

struct CommitOptions {
  /// The version the content was made from; nothing for a map without a prior.
  std::optional<VersionNumber> parent;
  bool publish = true;
};

struct CommitResult {
  VersionNumber version;
  std::string content_hash;
};

struct AreaSummary {
  std::string area;
  std::optional<VersionNumber> published;
  int versions = 0;
};

struct VersionSummary {
  VersionNumber version;
  std::optional<VersionNumber> parent;
  std::string content_hash;
  bool published = false;
  Stamp created;
  std::string tool;
};

struct ReturnResult {
  bool duplicate = false;  ///< The report was there already; nothing changed.
  int evidence_rows = 0;   ///< Rows added to the ledger.
  int rows_set_aside = 0;  ///< Rows that name a mode the published version does not have.
};

/// The map store: one SQLite file with the maps of all areas, their versions, and the ledger of
/// what shifts reported.
///
/// Versions are immutable; *published* is a pointer to one of them, per area. Mode probabilities
/// are derived: the version's own are the chain's distribution before any report, and the ledger's
/// evidence rows are filtered forward over them in the order of time, whatever order they arrived
/// in (model and formats: mapstore/README.md).
///
/// Every write is one durable transaction: after OK it survives a power failure, after an error the
/// store is as before. Threads: one thread per object; several processes may use one file.
///
/// Errors, of every function: kFailedPrecondition if the file is not a map store, or of a newer
/// schema, or if a write meets kReadOnly; kDataLoss if it is damaged; kUnavailable if it is locked
/// for too long, or the disk does not take it; kNotFound for an area or version that does not
/// exist. Messages start with `map store '<path>': `.
class MapStore {
 public:
  enum class Access {
    kReadOnly,         ///< Never writes, works on a read-only mount; the file must exist.
    kReadWrite,        ///< The file must exist.
    kReadWriteCreate,  ///< Makes an empty store if there is none.
  };

  static StatusOr<MapStore> Open(const std::string& path, Access access);

  MapStore(MapStore&&) noexcept;
  MapStore& operator=(MapStore&&) noexcept;
  ~MapStore();

  /// All areas by name.
  StatusOr<std::vector<AreaSummary>> Areas();

  /// All versions of an area, oldest first.
  StatusOr<std::vector<VersionSummary>> Versions(const std::string& area);

  /// The published version, or nothing if the area is new or has none.
  StatusOr<std::optional<VersionNumber>> PublishedVersion(const std::string& area);

  /// Adds a version and, if asked, publishes it; creates the area if it is new.
  /// Errors also: kInvalidArgument if ValidateMapContent fails; kAborted if `options.publish` and
  /// the published version is not `options.parent` (nothing is written then). A version without a
  /// parent may replace any published one.
  StatusOr<CommitResult> Commit(const std::string& area,
                                const MapContent& content,
                                const Provenance& provenance,
                                const CommitOptions& options);

  /// A version as it was committed: probabilities before any report.
  StatusOr<MapSnapshot> LoadVersion(const std::string& area, VersionNumber version);

  /// A version with the probabilities that the ledger implies at a time. Evidence counts if it was
  /// reported against this version, or against an ancestor for a visit after this version's stamp.
  /// @param version  Nothing: the published one.
  /// @param at       Nothing: the newest end of the evidence that counts, or the version's stamp if
  ///                 there is none. Visits that begin after `at` do not count. The version's own
  ///                 distribution comes before all evidence, also before evidence that is older
  ///                 than the version's stamp: a late report is filtered in its own order of time.
  ///                 Without evidence, a time before the stamp gives the distribution at the stamp.
  StatusOr<MapSnapshot> LoadAt(const std::string& area,
                               std::optional<VersionNumber> version = std::nullopt,
                               std::optional<Stamp> at = std::nullopt);

  StatusOr<Provenance> LoadProvenance(const std::string& area, VersionNumber version);

  /// Adds a shift report to the ledger; a report whose UUID is known changes nothing.
  /// Errors also: kNotFound if the report's area or version does not exist; kInvalidArgument if its
  /// content hash is not that version's.
  StatusOr<ReturnResult> Return(const ShiftReport& report);

  /// Unmapped sightings of an area, newest first.
  StatusOr<std::vector<UnmappedSighting>> Sightings(const std::string& area);

  /// Writes the published version of an area, with the probabilities of LoadAt, into a file of its
  /// own that MapStore opens read-only: what a vehicle carries. Verified, fsynced, then renamed
  /// into place. Returns the SHA-256 of the file.
  StatusOr<std::string> ExportSnapshot(const std::string& area, const std::string& path);

 private:
  struct State;
  explicit MapStore(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
