// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/ledger_cursor.h"
#include "mapstore/store/ledger_view.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The time that a reader asks for.
struct LedgerQuery {
  /// Nothing: the newest end of the visits that count, or the version's stamp if that is later.
  std::optional<Stamp> at = std::nullopt;

  /// What is later is a wrong clock's: without `at`, visits that begin later do not count, and a
  /// version's own later stamp is no bound.
  Stamp latest = Stamp::max();

  /// As it was known at this time (LedgerView); nothing: as it is known now.
  std::optional<Stamp> known = std::nullopt;
};

/// A visit that was filtered, and the distribution after it.
struct FilteredVisit {
  Stamp begin;
  Stamp end;
  std::int64_t report_id = 0;  ///< As LedgerRow has them.
  std::int64_t run_id = 0;
  std::int64_t version_id = 0;
  Eigen::VectorXd probabilities;  ///< Size states, at `end`.
};

/// Filters the probabilities of a version's groups over the ledger, T-IV (5, 13, 14), all groups in
/// one pass in the order of time, from the chains' stationary distributions on. The statement that
/// holds for the version, if there is one, is evidence at its stamp.
///
/// Cost: a checkpoint, then the rows after it.
/// Threads: one. Lifetime: the database's and the content's, inside one transaction.
class LedgerFilter {
 public:
  /// @param known  As LedgerQuery has it.
  LedgerFilter(Database& database,
               std::int64_t area_id,
               const VersionRow& version,
               const MapContent& content,
               std::optional<Stamp> known = std::nullopt);

  /// Begins at the newest checkpoint that holds no visit after `at`, or before all rows.
  /// Precondition: it filters what is known now, as checkpoints do.
  Status Start(std::optional<Stamp> at);

  /// Begins before all rows, as if there were no checkpoints.
  void StartFromNothing();

  /// Calls `watch` after each visit of a group of the content that it takes from now on.
  void Watch(std::size_t group, std::function<void(const FilteredVisit&)> watch) {
    watched_ = group;
    watch_ = std::move(watch);
  }

  /// Takes the visits that count and begin before `before`, from where it stands, and the statement
  /// if that is on the way. Returns how many rows it read.
  StatusOr<std::int64_t> AdvanceTo(Stamp before);

  /// Goes on to what a reader asks for, and returns the time at which the probabilities then hold.
  /// The version knows the runs that it and its ancestors mapped, whatever the time asked for: none
  /// is before its stamp. Of reported visits those count that begin at `query.at` or before.
  /// Nothing goes on from here.
  StatusOr<Stamp> Finish(const LedgerQuery& query);

  /// All visits that begin before this are in states().
  Stamp before() const { return before_; }

  const LedgerStates& states() const { return states_; }

  /// The probabilities of a group of the content at a time not before those it has: what the states
  /// imply, or the content's own where no evidence changed them.
  Eigen::VectorXd ProbabilitiesOf(std::size_t group, Stamp at) const;

  LedgerView& view() { return view_; }

 private:
  // Rows in the order of time, and the statement in its place among them. Returns the rows read.
  StatusOr<std::int64_t> Take(Stamp before, Stamp mapped_before);
  StatusOr<std::int64_t> TakeRows(Stamp before, Stamp mapped_before);
  Status HoldRow(const LedgerRow& row);
  void TakeHeld();
  Status TakeStatement(Stamp stamp);
  int GroupOf(std::string_view signature) const;

  Database* database_;
  std::int64_t area_id_;
  VersionRow version_;
  const MapContent* content_;
  std::unordered_map<std::string_view, int> group_index_;
  LedgerView view_;
  LedgerStates states_;
  Stamp before_ = Stamp::min();
  bool statement_taken_ = false;

  // A visit that counts, not taken yet: of several at the same time the order in which they came
  // must not matter.
  struct HeldVisit {
    std::size_t group = 0;
    Stamp begin;
    Stamp end;
    std::int64_t report_id = 0;
    std::int64_t run_id = 0;
    std::int64_t version_id = 0;
    const LedgerVehicle* vehicle = nullptr;
    Eigen::VectorXd log_likelihoods;
  };
  std::vector<HeldVisit> held_;  // The first held_count_, of the same begin and end.
  std::size_t held_count_ = 0;   // The others are kept for their memory.

  std::vector<VisitEvidence::ModeLogLikelihood> modes_;  // Kept for its memory.

  std::size_t watched_ = 0;
  std::function<void(const FilteredVisit&)> watch_;
};

/// Replaces the probabilities of `content` by what the ledger implies, and its stamp by the time at
/// which they hold: `at`, or else the newest end of the visits that count, or the version's stamp
/// if that is later. Returns the records of the vehicles then.
StatusOr<VehicleRecords> ApplyLedger(Database& database,
                                     std::int64_t area_id,
                                     const VersionRow& version,
                                     const LedgerQuery& query,
                                     MapContent* content);

}  // namespace shiftmap
