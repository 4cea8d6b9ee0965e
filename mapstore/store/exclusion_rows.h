// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "mapstore/sqlite/database.h"
#include "mapstore/store_types.h"
#include "proto/core/status.h"

namespace shiftmap {

/// All exclusions of an area, those of runs first.
StatusOr<std::vector<Exclusion>> ReadExclusions(Database& database, std::int64_t area_id);

/// Adds one. Returns false if it is there.
StatusOr<bool> InsertExclusion(Database& database,
                               std::int64_t area_id,
                               const Exclusion& exclusion);

/// Takes one back. Returns false if it is not there.
StatusOr<bool> DeleteExclusion(Database& database,
                               std::int64_t area_id,
                               const Exclusion& exclusion);

/// The run that is meant: a SHA-256 as it is, known or not; the log of a report if it has one, else
/// the report's UUID; or the only one that the store knows by these first digits.
/// Errors: kInvalidArgument if it may be several; kNotFound if it is none.
StatusOr<std::string> FindRun(Database& database, const std::string& text);

/// Answers whether a run is excluded.
class ExcludedRuns {
 public:
  explicit ExcludedRuns(const std::vector<Exclusion>& exclusions);

  bool empty() const { return runs_.empty() && vehicles_.empty(); }

  /// @param run  SHA-256 of its log, or UUID of its report.
  bool Contains(const std::string& run, const std::string& vehicle, Stamp begin) const;

 private:
  std::set<std::string> runs_;
  std::map<std::string, Stamp> vehicles_;  // Since when.
};

/// Names of the runs that a version or its ancestors mapped and that are excluded now.
StatusOr<std::vector<std::string>> FindExcludedRuns(Database& database,
                                                    std::int64_t area_id,
                                                    std::int64_t version_id);

}  // namespace shiftmap
