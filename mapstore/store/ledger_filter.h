// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/checkpoint_rows.h"
#include "mapstore/store/ledger_view.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Filters the probabilities of a version's groups over the ledger, T-IV (5, 13, 14), all groups in
/// one pass in the order of time: late visits first, on the version's own distribution, then what
/// counts in its turn.
///
/// Cost: a checkpoint, then the rows after it.
/// Threads: one. Lifetime: the database's and the content's, inside one transaction.
class LedgerFilter {
 public:
  LedgerFilter(Database& database,
               std::int64_t area_id,
               const VersionRow& version,
               const MapContent& content);

  /// Begins at the newest checkpoint that holds no visit after `at`, or at the version's own
  /// probabilities.
  /// @param without_runs  SHA-256 of logs; reports about them do not count.
  Status Start(std::optional<Stamp> at, const std::set<std::string>& without_runs = {});

  /// Begins at the version's own probabilities, as if there were no checkpoints.
  Status StartFromVersion();

  /// Takes the visits that count and begin before `before`, from where it stands. Returns how many
  /// rows it read.
  StatusOr<std::int64_t> AdvanceTo(Stamp before);

  /// All visits that begin before this are in states().
  Stamp before() const { return before_; }

  const LedgerStates& states() const { return states_; }

 private:
  Status ReadView();
  Status AddLate(Stamp first);
  Status AddRow(const Statement& row, std::vector<std::optional<ModeState>>* states, bool late);
  int GroupOf(std::string_view signature) const;

  Database* database_;
  std::int64_t area_id_;
  VersionRow version_;
  const MapContent* content_;
  std::unordered_map<std::string_view, int> group_index_;
  std::optional<LedgerView> view_;
  LedgerStates states_;
  Stamp before_ = Stamp::min();

  // Kept for their memory.
  std::vector<VisitEvidence::ModeLogLikelihood> modes_;
  Eigen::VectorXd log_likelihoods_;
};

/// The evidence that a reader asks for.
struct LedgerQuery {
  /// The time of the probabilities; nothing: the newest end of the visits that count.
  std::optional<Stamp> at = std::nullopt;

  /// Without `at`, visits that begin later do not count.
  Stamp latest = Stamp::max();

  /// SHA-256 of logs; reports about them do not count.
  std::set<std::string> without_runs = {};
};

/// Replaces the probabilities of `content` by what the ledger implies, and its stamp by the time at
/// which they hold: `at`, or else the newest end of the visits that count.
Status ApplyLedger(Database& database,
                   std::int64_t area_id,
                   const VersionRow& version,
                   const LedgerQuery& query,
                   MapContent* content);

}  // namespace shiftmap
