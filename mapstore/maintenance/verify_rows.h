// SPDX-License-Identifier: Apache-2.0
//
// The parts of VerifyStore.
#pragma once

#include <string>
#include <utility>

#include "mapstore/maintenance/verify.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Collects defects.
class DefectList {
 public:
  explicit DefectList(VerifyResult* result) : result_(result) {}

  void Add(const std::string& table, std::string row, std::string problem) {
    ++result_->defect_count;
    if (result_->defects.size() >= kMaxDefects) return;
    result_->defects.push_back({table, std::move(row), std::move(problem)});
  }

  VerifyResult& result() { return *result_; }

 private:
  VerifyResult* result_;
};

/// Pages, indices, references, schema.
Status VerifyFile(Database& database, DefectList* defects);

/// Rows against their checksums.
Status VerifyChecksums(Database& database, DefectList* defects);

/// Areas, versions, content, trajectories.
Status VerifyVersions(Database& database, DefectList* defects);

/// Edits, and the versions that are made of them.
Status VerifyEdits(Database& database, DefectList* defects);

/// Reports, evidence, decisions, sightings.
Status VerifyLedger(Database& database, DefectList* defects);

/// Versions and visits that are stamped ahead of this host's clock; these are findings.
Status FindFutureStamps(Database& database, DefectList* defects);

/// Checkpoints against the ledger.
Status VerifyCheckpoints(Database& database, DefectList* defects);

}  // namespace shiftmap
