// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/evidence_rows.h"

#include <algorithm>
#include <string_view>
#include <tuple>
#include <utility>

#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_view.h"
#include "mapstore/store/summary_rows.h"

namespace shiftmap {
namespace {

// Of a row of the query below.
SummaryKey KeyOfRow(const Statement& row) {
  return {row.Int64(1), row.Int64(2), row.Int64(4), row.Int64(5), row.Int64(9), row.Text(0)};
}

}  // namespace

StatusOr<std::vector<EvidenceRow>> ReadLineEvidence(Database& database,
                                                    std::int64_t area_id,
                                                    const VersionRow& version,
                                                    const std::set<std::string>& without_runs) {
  LedgerView view(database, version);
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT e.signature, e.begin_ns, e.end_ns, r.uuid, e.report_id, "
          "e.version_id, r.run_hash, e.log_likelihoods, e.observation_count, 0, r.vehicle, "
          "r.identity "
          "FROM visit_evidence e JOIN shift_report r USING (report_id) "
          "WHERE e.area_id = ?1 UNION ALL "
          "SELECT e.signature, e.begin_ns, e.end_ns, r.sha256, 0, "
          "e.version_id, r.sha256, e.log_likelihoods, e.observation_count, e.run_id, "
          "r.vehicle, r.identity "
          "FROM mapped_evidence e JOIN run r USING (run_id) "
          "WHERE e.area_id = ?1 ORDER BY 1, 2, 3, 4"));
  query.Bind(area_id);
  SHIFTMAP_ASSIGN_OR_RETURN(const auto summaries, ReadSummaries(database, area_id));
  std::vector<EvidenceRow> rows;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) break;
    if (without_runs.contains(query.Text(6)) || without_runs.contains(query.Text(11))) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const bool tells,
                              view.TellsOfPast(query.Int64(4), query.Int64(9), query.Int64(5)));
    if (!tells) continue;
    EvidenceRow row;
    row.source = query.Text(3);
    row.vehicle = query.Text(10);
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                              view.NameOf(query.Blob(0), query.Int64(5)));
    row.evidence.signature = Signature(std::string(name));
    row.evidence.begin = StampFromNanoseconds(query.Int64(1));
    row.evidence.end = StampFromNanoseconds(query.Int64(2));
    row.evidence.observations = query.Int64(8);
    if (!UnpackLogLikelihoods(query.Blob(7), &row.evidence.modes)) {
      return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                      database.name(),
                      query.Text(0),
                      ToSecondsSinceEpoch(row.evidence.begin));
    }
    SHIFTMAP_RETURN_IF_ERROR(view.Split(name, query.Int64(4), query.Int64(9), &row.evidence.modes));
    const auto summary = summaries.empty() ? summaries.end() : summaries.find(KeyOfRow(query));
    if (summary == summaries.end()) {
      rows.push_back(std::move(row));
      continue;
    }
    for (EvidenceRow& visit : ExpandSummary(row, summary->second)) rows.push_back(std::move(visit));
  }
  // The names of renamed landmarks are elsewhere in the order.
  const auto by_name = [](const EvidenceRow& a, const EvidenceRow& b) {
    return std::tie(a.evidence.signature, a.evidence.begin, a.evidence.end, a.source) <
           std::tie(b.evidence.signature, b.evidence.begin, b.evidence.end, b.source);
  };
  if (!std::is_sorted(rows.begin(), rows.end(), by_name)) {
    std::stable_sort(rows.begin(), rows.end(), by_name);
  }
  return rows;
}

}  // namespace shiftmap
