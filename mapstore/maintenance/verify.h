// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/core/status.h"

namespace shiftmap {

/// Something in a store that is not as it should be.
struct Defect {
  std::string table;  ///< Empty if it is about the file as a whole.
  std::string row;    ///< Which row, for people: its key.
  std::string problem;
};

struct VerifyResult {
  std::vector<Defect> defects;  ///< The first kMaxDefects.
  std::int64_t defect_count = 0;
  std::int64_t versions = 0;  ///< Looked at, like the following.
  std::int64_t reports = 0;
  std::int64_t evidence_rows = 0;
  std::int64_t checkpoints = 0;

  /// What is no defect, but a person should know: stamps ahead of this host's clock.
  std::vector<std::string> findings;

  bool clean() const { return defect_count == 0; }
};

inline constexpr std::size_t kMaxDefects = 1000;

/// Checks all that a store promises: SQLite's own checks of pages, indices and references; the
/// schema; every row's checksum; of every version the content hash, each covariance and the joint
/// one positive definite, probabilities and rates, parent and published pointer; trajectories; of
/// every report its visits, decisions and sightings, which of several reports about one run counts;
/// every ledger checkpoint against filtering the ledger anew.
///
/// Reads the whole file in one read transaction.
/// Errors: as MapStore::Open. What is wrong inside is no error but a defect.
StatusOr<VerifyResult> VerifyStore(const std::string& path);

}  // namespace shiftmap
