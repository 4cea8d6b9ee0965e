// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "mapstore/core/clock.h"
#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/landmark_records.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/mode_filter.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The map store: one SQLite file with the maps of all areas, their versions, and the ledger of
/// what shifts reported.
///
/// Versions are immutable; *published* is a pointer to one of them, per area. Mode probabilities
/// are derived: the ledger's rows, of mapped runs and of shifts, are filtered forward in the order
/// of time, whatever order they arrived in (mapstore/METHOD.md; the file: FORMATS.md).
///
/// Every write is one durable transaction: after OK it survives a power failure, after an error the
/// store is as before or, where the disk failed at the very end, as after it. Threads: one thread
/// per object; several processes may use one file.
///
/// Errors, of every function: kFailedPrecondition if the file is not a map store, or of a newer
/// schema, or if a write meets kReadOnly; kDataLoss if it is damaged; kUnavailable if it is locked
/// for too long, or the disk does not take it; kNotFound for an area or version that does not
/// exist. Messages start with `map store 'PATH': `.
class MapStore {
 public:
  enum class Access {
    kReadOnly,         ///< Never writes, works on a read-only mount; the file must exist.
    kReadWrite,        ///< The file must exist.
    kReadWriteCreate,  ///< Makes an empty store if there is none.
  };

  struct OpenOptions {
    Access access = Access::kReadOnly;

    /// How long a call waits for a lock that another process holds before kUnavailable.
    std::chrono::milliseconds lock_timeout{5000};

    /// Called once per wait that takes noticeably long, so that a program can say why it waits.
    std::function<void()> on_wait = nullptr;

    /// Network file systems are refused, because their locks do not hold, unless this is set, or
    /// SHIFTMAP_ALLOW_NETWORK_FILE_SYSTEM is 1 in the environment.
    bool allow_network_file_system = false;

    /// Evidence rows between two ledger checkpoints, for maps of few groups. Fewer make LoadAt
    /// faster and the file larger.
    std::int64_t checkpoint_rows = 12288;

    /// The time that stamps are compared with. What would be stamped later than this, and the
    /// tolerance, is not written; what an older build let in later does not count by itself.
    std::function<Stamp()> clock = SystemNow;
    double clock_tolerance_s = kDefaultClockToleranceS;  ///< At least 0. [s]
  };

  static StatusOr<MapStore> Open(const std::string& path, const OpenOptions& options);
  static StatusOr<MapStore> Open(const std::string& path, Access access);

  /// Whether a store could be written, or made, as far as permissions tell, for what works long
  /// before it commits. Makes and changes nothing. Errors: kNotFound if its folder does not exist;
  /// kFailedPrecondition if something else is at the path, or a snapshot; kUnavailable if the file
  /// or its folder may not be written to.
  /// @param dry_run  Nothing is to be written: a snapshot alone is an error.
  static Status CheckWritable(const std::string& path, bool dry_run = false);

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
  /// Errors also: kInvalidArgument if ValidateMapContent fails, or the content's stamp is ahead of
  /// the clock, or before its parent's (unless that is ahead of the clock itself), or the runs'
  /// evidence is not of the content and of the runs, or is there although the version states its
  /// probabilities, or is of a run that an ancestor has mapped; kDataLoss if a
  /// version of the area has a parent that is not an older version of it; kAborted if
  /// `options.publish` and the published version is not `options.parent` (nothing is written then).
  /// CommitOptions::replace: of a version without a parent.
  StatusOr<CommitResult> Commit(const std::string& area,
                                const MapContent& content,
                                const Provenance& provenance,
                                const CommitOptions& options);

  /// Notes runs that wait for another build, where no version is made: as CommitOptions::waiting.
  Status NoteWaiting(const std::string& area, const std::vector<UnplacedRun>& runs);

  /// Adds an entry to the audit log that changes nothing else.
  /// @param area  Nothing: it is about the whole store.
  Status AddNote(const std::optional<std::string>& area,
                 NightNote note,
                 const std::string& subject);

  /// Runs that waited for another build and are not in the published version nor in its ancestors,
  /// in the order they were noted.
  StatusOr<std::vector<UnplacedRun>> WaitingRuns(const std::string& area);

  /// Makes a version the published one, if `expected` is published now (nothing: if none is).
  /// Errors also: kAborted if another one is; kAlreadyExists if `version` is published already;
  /// kFailedPrecondition if its content was compacted away.
  /// @param dry_run  Checks, and writes nothing.
  Status Publish(const std::string& area,
                 VersionNumber version,
                 std::optional<VersionNumber> expected,
                 bool dry_run = false);

  /// Publishes an ancestor of the published version: its parent, or `to`. Nothing is deleted; what
  /// shifts reported against later versions keeps counting where its modes exist, until a build
  /// goes on from the ancestor. Returns the version that is published now.
  /// Errors also: kInvalidArgument if `to` is no ancestor.
  StatusOr<VersionNumber> Rollback(const std::string& area,
                                   std::optional<VersionNumber> to = std::nullopt,
                                   bool dry_run = false);

  /// A version as it was committed: with the probabilities that it states, before any report, or
  /// with its chains' stationary distributions if it states none.
  StatusOr<MapSnapshot> LoadVersion(const std::string& area, VersionNumber version);

  /// A version with the probabilities that the ledger implies at a time; which rows count, and how:
  /// mapstore/METHOD.md.
  /// @param version  Nothing: the published one.
  /// @param at       Nothing: the newest end of the evidence that counts, or the version's stamp if
  ///                 that is later; visits that begin after the clock's time with the tolerance do
  ///                 not count. Reported visits that begin after `at` do not count. A time before
  ///                 the version's stamp gives the distribution at its stamp.
  /// Errors also: kNotFound if the file is a snapshot whose ledger begins after `at`.
  StatusOr<MapSnapshot> LoadAt(const std::string& area,
                               std::optional<VersionNumber> version = std::nullopt,
                               std::optional<Stamp> at = std::nullopt);

  /// What LoadAt would have given at the time `known`, bit by bit: without what came, was
  /// published, excluded, held or taken back later, by the clocks of the machines that wrote. Rows
  /// that were compacted away are missing. Filters the whole ledger.
  /// @param version  Nothing: the one that was published then.
  /// @param at       Nothing: as for LoadAt, with `known` as the clock's time.
  /// Errors also: kNotFound if nothing was published, or the version was not there yet;
  /// kFailedPrecondition if the file is a snapshot.
  StatusOr<MapSnapshot> LoadKnown(const std::string& area,
                                  Stamp known,
                                  std::optional<VersionNumber> version = std::nullopt,
                                  std::optional<Stamp> at = std::nullopt);

  /// What the ledger says of the vehicles that others judged, by name: the newest visits included.
  /// @param version  Nothing: the published one.
  StatusOr<std::vector<VehicleTrust>> Trust(const std::string& area,
                                            std::optional<VersionNumber> version = std::nullopt);

  StatusOr<Provenance> LoadProvenance(const std::string& area, VersionNumber version);

  /// All runs that a version and its ancestors were built from, by begin and name.
  StatusOr<std::vector<LineRun>> LineRuns(const std::string& area, VersionNumber version);

  /// RunRecord::sha256 and RunRecord::identity of all runs that a version and its ancestors were
  /// built from.
  StatusOr<std::set<std::string>> RunIdentities(const std::string& area, VersionNumber version);

  /// Adds a shift report to the ledger; a report whose UUID is known changes nothing. The run of a
  /// live shift that ended before the newest run in its version is held, unless somebody included
  /// it before: its clock was behind.
  /// @param by  Who handed it in, for the audit log; empty: whoever may write the file.
  /// Errors also: kNotFound if the report's area or version does not exist; kInvalidArgument if
  /// ValidateShiftReport() refuses it or its content hash is not that version's; as CheckClock.
  StatusOr<ReturnResult> Return(const ShiftReport& report, const std::string& by = "");

  /// The same for several reports, with one transaction for all that are not refused. The results
  /// are in the order of the reports.
  std::vector<StatusOr<ReturnResult>> ReturnAll(const std::vector<AttributedReport>& reports);

  /// Notes in the audit log that a run log was handed in.
  /// @param log  Its hash.
  Status NoteUpload(const std::string& log, const std::string& by);

  /// Whether the clock lets a report in, for what wants to know before it writes.
  /// Errors: kInvalidArgument with both times if the report, or a visit in it, ends later than the
  /// clock's time with the tolerance.
  Status CheckClock(const ShiftReport& report) const;

  /// The area's reports, newest first, and what they mean for a version.
  /// @param version  Nothing: the published one.
  StatusOr<std::vector<ReportSummary>> Reports(const std::string& area,
                                               std::optional<VersionNumber> version = std::nullopt);

  /// What the ledger says of the landmarks of a version over all time: one set of rows per run,
  /// mapped by it or an ancestor, or else reported against it, its ancestors and its descendants.
  /// Other than for LoadAt, what a statement accounts for is there too: rates are learned from the
  /// whole past. By signature, then in the order of time.
  /// @param without_runs  SHA-256 or RunRecord::identity; what tells of them is left out.
  StatusOr<std::vector<EvidenceRow>> Evidence(const std::string& area,
                                              VersionNumber version,
                                              const std::set<std::string>& without_runs = {});

  /// All that the store tells of one landmark: its visits, whether and how they count for a map
  /// version, its modes in every version, and its probabilities over time. Filters the whole ledger
  /// of the area once, since vehicles are trusted by what they say of all landmarks.
  /// Errors also: kNotFound if neither a version nor the ledger has the landmark, or as LoadKnown.
  StatusOr<LandmarkRecords> LoadLandmark(const std::string& area,
                                         const Signature& signature,
                                         const LandmarkQuery& query = {});

  /// All landmarks of a version over time, for pictures that move: filters the whole ledger of the
  /// area once. The probabilities are those of LoadAt within 5e-4, from the version's stamp on.
  StatusOr<LandmarkTracks> LoadTracks(const std::string& area, const TracksQuery& query = {});

  /// From where the runs that a version's line mapped saw its modes, by signature and mode number,
  /// which may be that of a merged mode.
  /// @param without_runs  As for Evidence.
  StatusOr<std::vector<ModeVisibility>> MappedVisibility(
      const std::string& area,
      VersionNumber version,
      const std::set<std::string>& without_runs = {});

  /// Takes a run, or the runs of a vehicle, out of an area's memory: whatever is derived is as if
  /// they had never come, bit by bit. What a statement accounts for stays in it, and positions that
  /// were made from them stay in their versions (ExcludedRunsOf). An exclusion takes the
  /// place of a hold, and one of a vehicle that of a later one, since the earlier of the two times.
  /// @param exclusion  Its run may be the first digits of what the store knows, or the UUID or hash
  ///                   of a run, or the UUID of a report, that the store does not know yet. An
  ///                   exclusion of a report excludes the run of the report, at once or when the
  ///                   report comes.
  /// Errors also: kInvalidArgument if it names neither or both, the run may be several, or there is
  /// no reason; kNotFound if the run is none; kAlreadyExists if it is excluded, or held, already.
  Status Exclude(const std::string& area, Exclusion exclusion, bool dry_run = false);

  /// Several at once: all, or with an error none.
  Status ExcludeAll(const std::string& area,
                    std::vector<Exclusion> exclusions,
                    bool dry_run = false);

  /// Takes exclusions or holds back, all, or with an error none: all numbers are as they were.
  /// Errors also: kNotFound if one is neither excluded nor held.
  Status IncludeAll(const std::string& area,
                    std::vector<Exclusion> exclusions,
                    bool dry_run = false);

  /// The exclusions of an area: excluded ones, then held ones, of each those of runs first.
  StatusOr<std::vector<Exclusion>> Exclusions(const std::string& area);

  /// Names of the runs that a version or its ancestors mapped and that are excluded now: its
  /// positions still rest on them.
  StatusOr<std::vector<std::string>> ExcludedRunsOf(const std::string& area, VersionNumber version);

  /// Makes an edit in the published version, publishes the version that comes of it, and keeps the
  /// edit for every build to come. All in one transaction: a version that is published meanwhile is
  /// the one that is edited.
  /// @param edit  With its kind's members, author and reason; the store sets the others.
  /// Errors also: kInvalidArgument if ValidateEdit refuses it or the map cannot take it; kNotFound
  /// if nothing is published, or the version does not have the landmark, mode or vehicle;
  /// kFailedPrecondition if the file is a snapshot.
  StatusOr<EditResult> Edit(const std::string& area, MapEdit edit, bool dry_run = false);

  /// Takes an edit back: publishes the version that comes of the others. A build stays, and so do
  /// all rows. Where the published version was built on a position, split, control point or rate
  /// that is taken back, it stays published and rests on it (EditsOf) until the next build.
  /// Errors also: kNotFound if there is none of that id; kAlreadyExists if it was taken back;
  /// kInvalidArgument if author or reason are empty; kFailedPrecondition if another edit needs it.
  StatusOr<EditResult> UndoEdit(const std::string& area,
                                EditId edit,
                                EditUndo undo,
                                bool dry_run = false);

  /// All edits of an area, by id, those taken back included (MapEdit::undone).
  StatusOr<std::vector<MapEdit>> Edits(const std::string& area);

  /// How a version's frame lies to its parent's: where the version takes in or leaves a control
  /// point, the motion of the map (FitFrame); else, and where content was compacted away, the
  /// identity, because a build stays in the frame of the map it is built on.
  /// @return T_version_parent.
  StatusOr<Se2> FrameStep(const std::string& area, VersionNumber version);

  /// The edits that a version is made with, by id. One that was taken back since is among them if
  /// the version rests on it.
  StatusOr<std::vector<MapEdit>> EditsOf(const std::string& area, VersionNumber version);

  /// A version that holds the edits in force, for a build to go on from: `version` if it does, else
  /// a child of it that is not published. Edits of other lines of versions do not count, and what
  /// cannot be made in this one is left out.
  StatusOr<VersionNumber> WithEditsInForce(const std::string& area, VersionNumber version);

  /// Every write, oldest first; of one area, or of the whole store.
  /// @param only  Those of some kinds; empty: all.
  StatusOr<std::vector<AuditEntry>> AuditLog(const std::optional<std::string>& area = std::nullopt,
                                             const std::vector<AuditAction>& only = {});

  /// When reports of an area, and run logs of any, came, by time of receipt.
  StatusOr<std::vector<ReceivedRun>> ReceivedRuns(const std::string& area);

  /// Unmapped sightings of an area, newest first.
  StatusOr<std::vector<UnmappedSighting>> Sightings(const std::string& area);

  /// Writes the published version of an area, with the probabilities of LoadAt, into a file of its
  /// own that MapStore opens read-only: what a vehicle carries. Verified, fsynced, then renamed
  /// into place. Returns the SHA-256 of the file.
  StatusOr<std::string> ExportSnapshot(const std::string& area, const std::string& path);

  /// The same, with what tells this snapshot from others.
  StatusOr<ExportedSnapshot> ExportWithIdentity(const std::string& area, const std::string& path);

  /// A number that changes when anybody else, in this process or in another, has written the store.
  StatusOr<std::int64_t> DataVersion();

  /// What was written since a position in the audit log, 0 for all of it.
  StatusOr<StoreChanges> ChangesSince(std::int64_t position);

 private:
  struct State;
  explicit MapStore(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap
