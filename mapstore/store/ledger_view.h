// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <unordered_map>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/sqlite/database.h"
#include "mapstore/store/version_rows.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Which rows of the ledger count for a version, and how.
///
///   reported against the version itself or a descendant       counts, in the order of time
///   against an ancestor, visit began after the version's stamp  counts, in the order of time
///   against an ancestor, began earlier, report known when the
///   version was made (report_id <= ledger_position)             set aside: kInMap
///   against an ancestor, began earlier, report came later       late: AddLateVisits
///   against any other version                                   set aside: kOtherLine
///
/// and whatever the version, not if the report is superseded (kSameRun), or about a log that the
/// version or an ancestor was built from (kRunInMap). Groups and modes are not looked at here.
///
/// Threads: one. Lifetime: the database's, inside one transaction.
class LedgerView {
 public:
  static StatusOr<LedgerView> Make(Database& database, const VersionRow& version);

  /// Sets the reports about these logs aside, as kRunInMap. Returns whether one of them counted.
  /// @param runs  SHA-256 of logs.
  StatusOr<bool> SetRunsAside(const std::set<std::string>& runs);

  enum class Standing { kCounts, kLate, kSetAside };
  struct Verdict {
    Standing standing;
    SetAside reason;  ///< If set aside.
  };

  /// @param version_id  The report's.
  StatusOr<Verdict> Judge(std::int64_t report_id, std::int64_t version_id, Stamp begin);

  /// True if a report against `version_id` speaks of the version's own mode numbers: that is the
  /// version, an ancestor or a descendant.
  StatusOr<bool> IsOnLine(std::int64_t version_id);

  /// Where in the ledger the rows are that do not stand aside.
  struct Bounds {
    Stamp first_visit;  ///< Visits that count in the order of time do not begin before this,
    std::optional<Stamp> first_late_visit;  ///< late ones not before this, if there are any.
  };

  /// Cost: a look at each report that came after the version.
  StatusOr<Bounds> FindBounds();

 private:
  enum class Relation { kOwn, kAncestor, kOther };

  LedgerView(Database& database, const VersionRow& version)
      : database_(&database), version_(version) {}

  Status ReadSetAsideReports();
  StatusOr<Relation> RelationTo(std::int64_t version_id);

  /// True if `ancestor` is met on the way up from `descendant`, which has the larger number.
  StatusOr<bool> IsAncestor(const VersionRow& ancestor, VersionRow descendant);

  Database* database_;
  VersionRow version_;
  std::unordered_map<std::int64_t, Relation> relations_;
  std::unordered_map<std::int64_t, SetAside> set_aside_;  // By report.
};

}  // namespace shiftmap
