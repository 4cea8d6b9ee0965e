// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/evidence_rows.h"

#include <utility>

#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_view.h"

namespace shiftmap {

StatusOr<std::vector<EvidenceRow>> ReadLineEvidence(Database& database,
                                                    std::int64_t area_id,
                                                    const VersionRow& version,
                                                    const std::set<std::string>& without_runs) {
  SHIFTMAP_ASSIGN_OR_RETURN(LedgerView view, LedgerView::Make(database, version));
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare("SELECT e.begin_ns, e.end_ns, e.version_id, e.signature, e.log_likelihoods, "
                       "e.observation_count, r.uuid, r.run_hash "
                       "FROM visit_evidence e JOIN shift_report r USING (report_id) "
                       "WHERE e.area_id = ?1 AND r.superseded = 0 "
                       "ORDER BY e.signature, e.begin_ns, e.end_ns, r.uuid"));
  query.Bind(area_id);
  std::vector<EvidenceRow> rows;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool found, query.Step());
    if (!found) return rows;
    if (without_runs.contains(query.Text(7))) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const bool on_line, view.IsOnLine(query.Int64(2)));
    if (!on_line) continue;
    EvidenceRow row;
    row.report_uuid = query.Text(6);
    row.evidence.signature = Signature(query.Text(3));
    row.evidence.begin = StampFromNanoseconds(query.Int64(0));
    row.evidence.end = StampFromNanoseconds(query.Int64(1));
    row.evidence.observations = query.Int64(5);
    if (!UnpackLogLikelihoods(query.Blob(4), &row.evidence.modes)) {
      return DataLoss("{}: evidence of '{}' at {:.6f} s is damaged",
                      database.name(),
                      query.Text(3),
                      ToSecondsSinceEpoch(row.evidence.begin));
    }
    rows.push_back(std::move(row));
  }
}

}  // namespace shiftmap
