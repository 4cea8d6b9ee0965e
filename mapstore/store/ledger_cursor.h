// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/sqlite/database.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A row of the ledger: what a visit says of a landmark, reported after a shift or mapped.
struct LedgerRow {
  Stamp begin;
  Stamp end;
  std::int64_t report_id = 0;   ///< 0: the version mapped the run
  std::int64_t run_id = 0;      ///< of this id.
  std::int64_t version_id = 0;  ///< The version driven on, or that mapped the run.
  std::string_view signature;
  std::string_view log_likelihoods;  ///< As in blob.h.
};

/// What tells a row of the ledger apart within its area.
struct LedgerKey {
  Stamp begin;
  Stamp end;
  std::int64_t report_id = 0;  ///< 0: the version mapped the run
  std::int64_t run_id = 0;     ///< of this id; else these two are not part of the key.
  std::int64_t version_id = 0;
  std::string signature;
};

LedgerKey KeyOf(const LedgerRow& row);

Status DeleteLedgerRows(Database& database,
                        std::int64_t area_id,
                        const std::vector<LedgerKey>& keys);

/// The rows of an area in the order in which chains are filtered: by begin, then end; then reported
/// before mapped ones, these by version, run and signature.
///
/// Threads: one. Lifetime: the database's, inside one transaction.
class LedgerCursor {
 public:
  /// Visits with `from` <= begin < `before`; mapped ones up to `mapped_before`.
  static StatusOr<LedgerCursor> Make(
      Database& database, std::int64_t area_id, Stamp from, Stamp before, Stamp mapped_before);

  /// The next row, or null after the last one. What it points to holds until the next call.
  StatusOr<const LedgerRow*> Next();

 private:
  struct Source {
    Statement rows;
    std::optional<LedgerRow> row;  // The next one, if there is one.
  };

  explicit LedgerCursor(std::array<Source, 2> sources) : sources_(std::move(sources)) {}
  static Status Step(Source* source);

  std::array<Source, 2> sources_;     // Reported, mapped.
  std::optional<std::size_t> taken_;  // Whose row was given out.
};

}  // namespace shiftmap
