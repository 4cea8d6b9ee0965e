// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/ledger_cursor.h"

#include <tuple>

namespace shiftmap {

LedgerKey KeyOf(const LedgerRow& row) {
  return {
      row.begin, row.end, row.report_id, row.run_id, row.version_id, std::string(row.signature)};
}

Status DeleteLedgerRows(Database& database,
                        std::int64_t area_id,
                        const std::vector<LedgerKey>& keys) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement reported,
      database.Prepare("DELETE FROM visit_evidence WHERE area_id = ?1 AND begin_ns = ?2 "
                       "AND end_ns = ?3 AND report_id = ?4 AND signature = ?5"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement mapped,
      database.Prepare("DELETE FROM mapped_evidence WHERE area_id = ?1 AND begin_ns = ?2 "
                       "AND end_ns = ?3 AND version_id = ?4 AND run_id = ?5 AND signature = ?6"));
  for (const LedgerKey& key : keys) {
    const std::int64_t begin_ns = ToNanoseconds(key.begin);
    const std::int64_t end_ns = ToNanoseconds(key.end);
    if (key.report_id != 0) {
      reported.Bind(area_id, begin_ns, end_ns, key.report_id, key.signature);
      SHIFTMAP_RETURN_IF_ERROR(reported.Execute());
    } else {
      mapped.Bind(area_id, begin_ns, end_ns, key.version_id, key.run_id, key.signature);
      SHIFTMAP_RETURN_IF_ERROR(mapped.Execute());
    }
  }
  return OkStatus();
}

StatusOr<LedgerCursor> LedgerCursor::Make(
    Database& database, std::int64_t area_id, Stamp from, Stamp before, Stamp mapped_before) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement reported,
      database.Prepare(
          "SELECT begin_ns, end_ns, report_id, 0, version_id, signature, log_likelihoods "
          "FROM visit_evidence WHERE area_id = ?1 AND begin_ns >= ?2 "
          "AND begin_ns < ?3 ORDER BY begin_ns, end_ns, report_id, signature"));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement mapped,
      database.Prepare("SELECT begin_ns, end_ns, 0, run_id, version_id, signature, log_likelihoods "
                       "FROM mapped_evidence WHERE area_id = ?1 AND begin_ns >= ?2 "
                       "AND begin_ns < ?3 ORDER BY begin_ns, end_ns, version_id, run_id, "
                       "signature"));
  std::array<Source, 2> sources{Source{std::move(reported), std::nullopt},
                                Source{std::move(mapped), std::nullopt}};
  sources[0].rows.Bind(area_id, ToNanoseconds(from), ToNanoseconds(before));
  sources[1].rows.Bind(area_id, ToNanoseconds(from), ToNanoseconds(mapped_before));
  for (Source& source : sources) SHIFTMAP_RETURN_IF_ERROR(Step(&source));
  return LedgerCursor(std::move(sources));
}

Status LedgerCursor::Step(Source* source) {
  SHIFTMAP_ASSIGN_OR_RETURN(const bool found, source->rows.Step());
  source->row.reset();
  if (!found) return OkStatus();
  source->row = LedgerRow{StampFromNanoseconds(source->rows.Int64(0)),
                          StampFromNanoseconds(source->rows.Int64(1)),
                          source->rows.Int64(2),
                          source->rows.Int64(3),
                          source->rows.Int64(4),
                          source->rows.Blob(5),
                          source->rows.Blob(6)};
  return OkStatus();
}

StatusOr<const LedgerRow*> LedgerCursor::Next() {
  if (taken_) SHIFTMAP_RETURN_IF_ERROR(Step(&sources_[*taken_]));
  const std::optional<LedgerRow>& reported = sources_[0].row;
  const std::optional<LedgerRow>& mapped = sources_[1].row;
  const bool mapped_first = mapped && (!reported || std::tie(mapped->begin, mapped->end) <
                                                        std::tie(reported->begin, reported->end));
  taken_ = mapped_first ? 1 : 0;
  const std::optional<LedgerRow>& next = sources_[*taken_].row;
  return next ? &*next : static_cast<const LedgerRow*>(nullptr);
}

}  // namespace shiftmap
