// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/summary_rows.h"

#include <algorithm>

#include "mapstore/sqlite/row_checksum.h"
namespace shiftmap {

SummaryKey SummaryKeyOf(const LedgerKey& row) {
  return {ToNanoseconds(row.begin),
          ToNanoseconds(row.end),
          row.report_id,
          row.version_id,
          row.run_id,
          row.signature};
}

StatusOr<std::map<SummaryKey, LedgerSummary>> ReadSummaries(Database& database,
                                                            std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT begin_ns, end_ns, report_id, version_id, run_id, signature, visits, "
                       "steps, gap_s FROM ledger_summary WHERE area_id = ?1"));
  rows.Bind(area_id);
  std::map<SummaryKey, LedgerSummary> summaries;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) return summaries;
    const SummaryKey key{
        rows.Int64(0), rows.Int64(1), rows.Int64(2), rows.Int64(3), rows.Int64(4), rows.Text(5)};
    const LedgerSummary summary{rows.Int64(6), rows.Int64(7), rows.Double(8)};
    const double length_s =
        1e-9 * (static_cast<double>(rows.Int64(1)) - static_cast<double>(rows.Int64(0)));
    if (summary.visits < 2 || summary.steps < 1 || summary.steps >= summary.visits ||
        !(summary.gap_s >= 0.0) || !(summary.gap_s <= 1.001 * length_s + 1.0)) {
      return DataLoss(
          "{}: summary of '{}' at {} ns is damaged", database.name(), rows.Text(5), rows.Int64(0));
    }
    summaries.emplace(key, summary);
  }
}

Status InsertSummary(Database& database,
                     std::int64_t area_id,
                     const LedgerKey& row,
                     std::int64_t observations,
                     const std::string& log_likelihoods,
                     const LedgerSummary& summary) {
  const std::int64_t begin_ns = ToNanoseconds(row.begin);
  const std::int64_t end_ns = ToNanoseconds(row.end);
  const bool reported = row.report_id != 0;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement evidence,
      database.Prepare(InsertRowSql(
          reported ? "visit_evidence" : "mapped_evidence",
          fmt::format(
              "area_id, begin_ns, end_ns, {}, observation_count, log_likelihoods",
              reported ? "report_id, signature, version_id" : "version_id, run_id, signature"))));
  const BlobView blob{log_likelihoods};
  if (reported) {
    evidence.Bind(area_id,
                  begin_ns,
                  end_ns,
                  row.report_id,
                  row.signature,
                  row.version_id,
                  observations,
                  blob);
  } else {
    evidence.Bind(
        area_id, begin_ns, end_ns, row.version_id, row.run_id, row.signature, observations, blob);
  }
  SHIFTMAP_RETURN_IF_ERROR(evidence.Execute());
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement insert,
      database.Prepare(InsertRowSql(
          "ledger_summary",
          "area_id, begin_ns, end_ns, report_id, version_id, run_id, signature, visits, steps, "
          "gap_s")));
  insert.Bind(area_id,
              begin_ns,
              end_ns,
              row.report_id,
              row.version_id,
              row.run_id,
              row.signature,
              summary.visits,
              summary.steps,
              summary.gap_s);
  return insert.Execute();
}

Status DeleteOrphanedSummaries(Database& database, std::int64_t area_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement orphaned,
      database.Prepare(
          "DELETE FROM ledger_summary WHERE area_id = ?1 "
          "AND NOT EXISTS (SELECT 1 FROM visit_evidence e WHERE e.area_id = ?1 "
          "AND e.begin_ns = ledger_summary.begin_ns AND e.end_ns = ledger_summary.end_ns "
          "AND e.report_id = ledger_summary.report_id "
          "AND e.signature = ledger_summary.signature) "
          "AND NOT EXISTS (SELECT 1 FROM mapped_evidence e WHERE e.area_id = ?1 "
          "AND e.begin_ns = ledger_summary.begin_ns AND e.end_ns = ledger_summary.end_ns "
          "AND ledger_summary.report_id = 0 AND e.version_id = ledger_summary.version_id "
          "AND e.run_id = ledger_summary.run_id AND e.signature = ledger_summary.signature)"));
  orphaned.Bind(area_id);
  return orphaned.Execute();
}

std::vector<EvidenceRow> ExpandSummary(const EvidenceRow& row, const LedgerSummary& summary) {
  const Stamp begin = row.evidence.begin;
  const double length_s = ToSeconds(row.evidence.end - begin);
  const auto steps = static_cast<double>(summary.steps);
  const double visit_s = std::max(0.0, length_s - summary.gap_s) / (steps + 1.0);
  std::vector<EvidenceRow> rows(static_cast<std::size_t>(summary.steps) + 1, row);
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const double since_s = static_cast<double>(i) * (length_s - visit_s) / steps;
    rows[i].evidence.begin = begin + FromSeconds(since_s);
    rows[i].evidence.end = std::min(row.evidence.end, begin + FromSeconds(since_s + visit_s));
  }
  return rows;
}

}  // namespace shiftmap
