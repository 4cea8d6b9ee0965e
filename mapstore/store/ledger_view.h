// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/evidence.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/map/mode_split.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/exclusion_rows.h"
#include "mapstore/store/ledger_cursor.h"
#include "mapstore/store/mode_numbers.h"
#include "mapstore/store/version_rows.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Whose visits the rows of a report or a run are.
struct LedgerVehicle {
  std::string name;
  std::int64_t key = 0;  ///< VehicleKey of the name.
  std::string source;    ///< UUID of the report, or SHA-256 of the run's log.
  std::string run;       ///< RunRecord::identity, or UUID of the report of a shift without a log.
};

/// Which rows of the ledger count for a version. All that count do so in the order of time.
///
///   mapped by the version or an ancestor                       counts
///   reported against the version, an ancestor or a descendant  counts, but not
///     if one of these about the run comes before it            kSameRun
///     if the version or an ancestor mapped the run             kRunInMap
///   mapped by a descendant                                     kLaterVersion
///   anything else                                              kOtherLine
///
/// and nothing of a run that an operator excluded (kExcluded) or holds (kHeld).
///
/// Where the version, or the nearest ancestor that does, states probabilities, these account for
/// what was mapped up to it, and for what was reported against its ancestors, was known to it
/// (report_id <= ledger_position) and began up to its stamp: kInMap. Groups and modes are not
/// looked at here.
///
/// As known at a time: with the reports that had come by then (the others: kUnknown), and the
/// exclusions that held. The version is to be made by then.
///
/// Cost: what it is asked about; a report or version asked about again costs nothing.
/// Threads: one. Lifetime: the database's, inside one transaction.
class LedgerView {
 public:
  /// @param known  Nothing: what is known now.
  LedgerView(Database& database,
             const VersionRow& version,
             std::optional<Stamp> known = std::nullopt)
      : database_(&database), version_(version), known_(known), top_(version) {}

  /// Why a row of a report does not count; nothing if it does.
  /// @param version_id  The report's.
  StatusOr<std::optional<SetAside>> JudgeReported(std::int64_t report_id,
                                                  std::int64_t version_id,
                                                  Stamp begin);

  /// As JudgeReported, for a row that a version mapped.
  StatusOr<std::optional<SetAside>> JudgeMapped(std::int64_t version_id, std::int64_t run_id);

  /// Whether the rows that a version mapped count, but for runs that are excluded or held.
  StatusOr<bool> Maps(std::int64_t version_id);

  /// Whether the rows of a run that a version mapped count.
  StatusOr<bool> CountsMapped(std::int64_t version_id, std::int64_t run_id);

  /// Whether a row of the ledger counts.
  StatusOr<bool> Counts(const LedgerRow& row);

  /// Whether a row of the ledger tells of the past of the version's chains. What a statement
  /// accounts for does too.
  /// @param report_id, run_id  As LedgerRow has them.
  StatusOr<bool> TellsOfPast(std::int64_t report_id, std::int64_t run_id, std::int64_t version_id);

  /// Whose visit a row of the ledger is. Holds as long as the view.
  /// @param report_id, run_id  As LedgerRow has them.
  StatusOr<const LedgerVehicle*> VehicleOf(std::int64_t report_id, std::int64_t run_id);

  /// The name that the view's version has for the landmark which another version calls `signature`.
  /// Holds as long as the view.
  StatusOr<std::string_view> NameOf(std::string_view signature, std::int64_t version_id);

  /// The other way: the name that another version has for a landmark of the view's.
  StatusOr<std::string> NameIn(std::int64_t version_id, const std::string& signature);

  /// Modes that the version holds split, of a landmark by its name there, in the order of the
  /// edits.
  StatusOr<std::vector<ModeSplit>> SplitsOf(std::string_view name);

  /// Adds to a row's log-likelihoods what the row tells of modes that were split since it was made.
  /// @param name  Of the landmark in the view's version.
  /// @param report_id, run_id  As LedgerRow has them.
  Status Split(std::string_view name,
               std::int64_t report_id,
               std::int64_t run_id,
               std::vector<VisitEvidence::ModeLogLikelihood>* modes);

  /// The version whose statement holds; null if none does.
  StatusOr<const VersionRow*> StatementRow();

 private:
  enum class Relation { kSelf, kAncestor, kDescendant, kOther };

  /// A version, seen from the view's.
  struct Place {
    Relation relation = Relation::kOther;
    bool before_statement = false;  ///< An ancestor of the version whose statement holds.
    bool at_statement = false;      ///< That version itself.

    bool in_line() const { return relation == Relation::kSelf || relation == Relation::kAncestor; }

    /// What it mapped is in the statement.
    bool stated() const { return before_statement || at_statement; }
  };

  StatusOr<Place> PlaceOf(std::int64_t version_id);
  StatusOr<Relation> RelationTo(const VersionRow& other);

  /// What is true of all rows of a report.
  struct Whole {
    std::optional<SetAside> reason;  ///< Why it stands aside.
    bool mapped_rows = false;        ///< The ledger has rows of its run, mapped for this version.
  };

  StatusOr<Whole> JudgeWhole(std::int64_t report_id);
  StatusOr<std::optional<SetAside>> ExclusionOf(std::int64_t run_id);
  StatusOr<bool> IsSuperseded(std::int64_t report_id);
  StatusOr<const std::vector<Exclusion>*> Exclusions();
  StatusOr<std::int64_t> AreaId();

  /// The names of a version; null if the area has no renames.
  StatusOr<const LandmarkNames*> NamesOf(std::int64_t version_id);

  StatusOr<bool> HasEdits(EditKind kind);
  Status ReadSplits();

  Database* database_;
  VersionRow version_;
  std::optional<std::int64_t> area_id_;  // Once it was asked for.
  std::optional<Stamp> known_;
  VersionRow top_;                              // The oldest ancestor that was read,
  std::unordered_set<std::int64_t> ancestors_;  // and all from the version to it.
  std::optional<VersionRow> statement_;
  std::unordered_map<std::int64_t, Place> places_;
  std::unordered_map<std::int64_t, Whole> reports_;
  std::unordered_map<std::int64_t, std::optional<SetAside>> excluded_runs_;
  std::unordered_map<std::int64_t, LedgerVehicle> report_vehicles_;
  std::unordered_map<std::int64_t, LedgerVehicle> run_vehicles_;
  std::optional<std::vector<Exclusion>> exclusions_;
  std::optional<bool> has_renames_;
  std::unordered_map<std::int64_t, LandmarkNames> names_;              // By version.
  std::map<std::pair<std::int64_t, std::string>, std::string> named_;  // NameOf.
  std::optional<std::map<std::string, std::vector<ModeSplit>, std::less<>>> splits_;
  std::optional<ModeNumbers> numbers_;  // Of the version; only if it holds splits.
};

/// ReadStatement of a version for groups of the view's.
StatusOr<std::vector<std::optional<Eigen::VectorXd>>> ReadStatementFor(
    Database& database,
    std::int64_t version_id,
    const std::vector<LandmarkGroup>& groups,
    LedgerView* view);

}  // namespace shiftmap
