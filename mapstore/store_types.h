// SPDX-License-Identifier: Apache-2.0
//
// What goes into a map store and comes out of it, besides the map itself.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/map/run_record.h"
#include "mapstore/map/visibility.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// A run that a version or one of its ancestors was built from.
struct LineRun {
  RunRecord run;          ///< Without trajectory, evidence and visibility.
  VersionNumber version;  ///< That one.
  Stamp committed;        ///< When it was, by the clock of the machine that did.
};

/// Where a version comes from.
struct Provenance {
  std::string tool;           ///< E.g. "shiftmap-mapper 0.1.0".
  std::string configuration;  ///< Effective options, JSON.
  std::int64_t seed = 0;
  std::vector<RunRecord> runs;  ///< By begin, then hash.

  /// Runs of ancestors whose evidence says more, of modes that they did not know. It goes into the
  /// ledger, beside what the ancestors mapped; these do not come back.
  std::vector<RunRecord> older = {};
};

/// How far the others' visits leave a vehicle trusted.
struct VehicleTrust {
  std::string vehicle;
  double broken = 0.0;  ///< Probability that it is (VehicleRecords).
};

/// Whether a vehicle is more likely broken than not.
inline bool IsDistrusted(const VehicleTrust& trust) { return trust.broken > 0.5; }

/// A run that a build was given and could not place: it may lie at several places in the map.
struct UnplacedRun {
  std::string name;
  std::string sha256;
  Stamp since;  ///< When a build first said so; set by the store.
};

/// What an operator takes out of an area's memory: a run, or all runs of a vehicle since a time.
/// One that is held counts for nothing until somebody decides, and no build takes it, but versions
/// that mapped it stay good.
struct Exclusion {
  std::string run;      ///< RunRecord::identity; empty: it is about a vehicle.
  std::string vehicle;  ///< Empty: it is about a run.
  Stamp since;          ///< Of a vehicle: runs that begin then or later.
  std::string reason;
  bool held = false;
  Stamp excluded = {};  ///< Set by the store.
};

/// The first exclusion that is about a run, or null. In the order of MapStore::Exclusions, a hold
/// hides no exclusion.
/// @param run     RunRecord::identity, or ReportSummary::run.
/// @param sha256  Of its log, by which it may have been excluded before anything else of it was
///                known; empty if it left none.
const Exclusion* FindExclusion(const std::vector<Exclusion>& exclusions,
                               const std::string& run,
                               const std::string& sha256,
                               const std::string& vehicle,
                               Stamp begin);
const Exclusion* FindExclusion(const std::vector<Exclusion>& exclusions, const RunRecord& run);

struct CommitOptions {
  /// The version the content was made from; nothing for a map without a prior.
  std::optional<VersionNumber> parent;

  bool publish = true;

  /// Of a statement, MapSnapshot::ledger_position: the reports that it accounts for. Nothing: all
  /// that the store holds when it commits.
  std::optional<LedgerPosition> ledger_position = std::nullopt;

  /// False: the version's probabilities are derived, from what the ledger holds and the runs'
  /// evidence adds; the content's own are not stored. True: they are a statement, as of an import,
  /// which accounts for all that was known of the line up to the content's stamp.
  bool states_probabilities = true;

  /// Runs that wait for another build.
  std::vector<UnplacedRun> waiting = {};

  /// The version that must be published now; nothing: the parent. Another one if the parent is the
  /// newest ancestor that is made from no excluded run.
  std::optional<VersionNumber> expected = std::nullopt;

  /// Whether a version without a parent is published whatever is; otherwise only if none is.
  bool replace = true;

  /// Edits that were taken back, that the parent holds, and that nothing of the content rests on.
  std::vector<EditId> without_edits = {};
};

struct CommitResult {
  VersionNumber version;
  std::string content_hash;
};

/// What became of an edit, or of taking one back.
struct EditResult {
  EditId edit;

  /// The version that is published with it now; nothing if none is made: in a dry run, or of an
  /// edit that the published version does not hold, or that cannot be taken out of it.
  std::optional<CommitResult> version;

  /// Of an edit taken back: the published version still rests on it, and the next build goes on
  /// without it.
  bool rests_on = false;

  /// Of a surveyed position: how far from where runs saw the mode.
  struct Move {
    double distance_m = 0.0;
    double sds = 0.0;  ///< In standard deviations of the difference.
  };
  std::optional<Move> move;

  /// Of a merge: control points of the mode that goes, which hold nothing from now on.
  std::vector<EditId> released;
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
  bool content_stored = true;  ///< False if it was compacted away, or left out of a snapshot.
  Stamp stamp;                 ///< When its own probabilities hold.
  Stamp created;
  std::string tool;
};

/// Why an evidence row of the ledger does not count for a map version. It is kept all the same.
enum class SetAside {
  kExcluded,      ///< An operator took its run, or its vehicle, out.
  kHeld,          ///< An operator holds its run, or its vehicle.
  kUnknown,       ///< It came after the time of which is asked what was known.
  kInMap,         ///< The probabilities that the version, or an ancestor, states account for it.
  kRunInMap,      ///< The version was built from the log that the report is about.
  kSameRun,       ///< Another report about the same log counts.
  kOtherLine,     ///< Made against a version that is neither ancestor nor descendant.
  kNoLandmark,    ///< The version does not have the landmark.
  kNoMode,        ///< What the row favours most is a mode that the version does not have.
  kLaterVersion,  ///< A descendant of the version mapped it.
  kAhead,         ///< It begins later than the time that clocks allow.
};

/// In words, for people.
const char* Describe(SetAside reason);

struct SetAsideRows {
  SetAside reason;
  int rows = 0;
};

struct ReturnResult {
  bool duplicate = false;  ///< The report was there already; nothing changed.
  int evidence_rows = 0;   ///< Rows added to the ledger.

  /// Those of them that do not count for the published version, by reason.
  std::vector<SetAsideRows> set_aside;
};

/// A report that came over a network.
struct AttributedReport {
  ShiftReport report;
  std::string by;  ///< Who handed it in.
};

/// What was written into a snapshot file.
struct ExportedSnapshot {
  std::string sha256;  ///< Of the file, in hex.
  VersionNumber version;
  std::string content_hash;
  LedgerPosition ledger_position;  ///< The reports that were in the store.
};

/// An area as a server watches it.
struct AreaState {
  std::string area;
  std::optional<VersionNumber> published;
  Stamp created;  ///< When the published version was made.

  /// Position of the newest write that may change what LoadAt() gives; 0: none since the position
  /// that was asked for.
  std::int64_t last_change = 0;

  std::int64_t held_reports = 0;  ///< Reports about runs that are held.
};

struct StoreChanges {
  std::int64_t position = 0;     ///< Of the newest write.
  std::vector<AreaState> areas;  ///< All of them, by name.
};

/// A shift report in the ledger, and what it means for one map version.
struct ReportSummary {
  std::string uuid;
  std::string run;  ///< Identity of its run: its UUID, else the hash of its log, else `uuid`.
  std::string vehicle;
  VersionNumber version;  ///< The one driven on.
  std::string run_hash;
  std::string software;
  Stamp begin;
  Stamp end;
  Stamp received;
  int decisions = 0;
  int sightings = 0;
  int evidence_rows = 0;
  std::vector<SetAsideRows> set_aside;  ///< Evidence rows that do not count, by reason.
};

/// What a nightly job concludes and keeps in the audit log.
enum class NightNote {
  kRefused,  ///< AuditAction::kRefuse.
  kLocated,  ///< AuditAction::kLocate.
  kLeftOut,  ///< AuditAction::kLeave.
};

/// What a write did, and what its subject is.
enum class AuditAction {
  kCommit,    ///< A version was made; its number.
  kPublish,   ///< Vehicles get a version from then on; its number.
  kRollback,  ///< The same, of one that was published before.
  kReturn,    ///< A report came; its UUID, and who handed it in.
  kUpload,    ///< A run log came over a network; its hash, and who handed it in.
  kWait,      ///< A run waits for another build; its log's hash, a blank and its name.
  kRefuse,    ///< A nightly job does not publish a version; its number, a blank and the reasons.
  kLocate,    ///< The area of a log that names none was looked for; as the nightly job has it.
  kExclude,   ///< `run <identity>` or `vehicle NAME`, a colon and the reason.
  kHold,      ///< The same.
  kInclude,   ///< The same, without a reason.
  kEdit,      ///< An edit was made; its words.
  kUndo,      ///< An edit was taken back; its words.
  kCompact,   ///< What became of it.
  kMigrate,   ///< The two schemas.
  kLeave,     ///< A nightly job leaves runs out; a hash of why, and their identities.
};

/// The word that stands for it in the store, e.g. "publish".
const char* ToString(AuditAction action);

/// A write.
struct AuditEntry {
  Stamp written;
  std::string area;     ///< Empty if it was about the whole store.
  std::string action;   ///< As ToString(AuditAction) gives it.
  std::string subject;  ///< See AuditAction.

  bool Is(AuditAction of) const { return action == ToString(of); }
};

/// A log that came over a network, or a report about a run, by two clocks: stamps are the
/// vehicle's, the time of receipt is the store's.
struct ReceivedRun {
  std::string run;      ///< RunRecord::identity; of an upload the log's hash.
  std::string vehicle;  ///< Empty of an upload.
  Stamp begin;          ///< Of the report; of an upload that of Unix time.
  Stamp end;
  Stamp received;

  /// Of a report about a live stream: the version driven on, which was there before the shift.
  std::optional<VersionNumber> driven_on;
};

}  // namespace shiftmap
