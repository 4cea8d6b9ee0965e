// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/report_summary.h"

#include <map>
#include <optional>
#include <unordered_map>
#include <utility>

#include "mapstore/map/mode_filter.h"
#include "mapstore/store/blob.h"
#include "mapstore/store/ledger_view.h"

namespace shiftmap {
namespace {

using Counts = std::map<SetAside, int>;

std::vector<SetAsideRows> ToRows(const Counts& counts) {
  std::vector<SetAsideRows> rows;
  rows.reserve(counts.size());
  for (const auto& [reason, count] : counts) rows.push_back({reason, count});
  return rows;
}

// Why a group does not take a row, or nothing. @param group  Null if the version does not have it.
std::optional<SetAside> ReasonOfGroup(const LandmarkGroup* group,
                                      const std::vector<VisitEvidence::ModeLogLikelihood>& modes) {
  if (group == nullptr) return SetAside::kNoLandmark;
  return FavoursKnownMode(*group, modes) ? std::nullopt : std::optional(SetAside::kNoMode);
}

StatusOr<std::vector<ReportSummary>> ReadReports(
    Database& database,
    std::int64_t area_id,
    std::unordered_map<std::int64_t, std::size_t>* index_of_id) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement query,
      database.Prepare(
          "SELECT report_id, uuid, identity, vehicle, v.number, run_hash, software, begin_ns, "
          "end_ns, received_ns, (SELECT count(*) FROM decision d WHERE d.report_id = r.report_id), "
          "(SELECT count(*) FROM sighting s WHERE s.report_id = r.report_id) "
          "FROM shift_report r JOIN version v USING (version_id) WHERE v.area_id = ?1 "
          "ORDER BY end_ns DESC, uuid"));
  query.Bind(area_id);
  std::vector<ReportSummary> reports;
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, query.Step());
    if (!row) return reports;
    ReportSummary report;
    report.uuid = query.Text(1);
    report.run = query.Text(2);
    report.vehicle = query.Text(3);
    report.version = VersionNumber(query.Int64(4));
    report.run_hash = query.Text(5);
    report.software = query.Text(6);
    report.begin = StampFromNanoseconds(query.Int64(7));
    report.end = StampFromNanoseconds(query.Int64(8));
    report.received = StampFromNanoseconds(query.Int64(9));
    report.decisions = static_cast<int>(query.Int64(10));
    report.sightings = static_cast<int>(query.Int64(11));
    index_of_id->emplace(query.Int64(0), reports.size());
    reports.push_back(std::move(report));
  }
}

}  // namespace

StatusOr<std::vector<SetAsideRows>> CountSetAside(Database& database,
                                                  const VersionRow& published,
                                                  const VersionRow& reported,
                                                  const InsertedReport& inserted,
                                                  const ShiftReport& report,
                                                  ModeNumbers* numbers) {
  LedgerView view(database, published);
  Counts counts;
  for (const VisitEvidence& evidence : report.evidence) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        const std::optional<SetAside> aside,
        view.JudgeReported(inserted.report_id, reported.version_id, evidence.begin));
    if (aside) {
      ++counts[*aside];
      continue;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                              view.NameOf(evidence.signature.text(), reported.version_id));
    SHIFTMAP_ASSIGN_OR_RETURN(const LandmarkGroup* const group,
                              numbers->Find(database, Signature(std::string(name))));
    const auto reason = ReasonOfGroup(group, evidence.modes);
    if (reason) ++counts[*reason];
  }
  return ToRows(counts);
}

StatusOr<std::vector<ReportSummary>> SummarizeReports(Database& database,
                                                      std::int64_t area_id,
                                                      const VersionRow& version,
                                                      const MapContent& content) {
  std::unordered_map<std::int64_t, std::size_t> index_of_id;
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<ReportSummary> reports,
                            ReadReports(database, area_id, &index_of_id));
  std::unordered_map<std::string, const LandmarkGroup*> groups;
  for (const LandmarkGroup& group : content.groups) groups.emplace(group.signature.text(), &group);
  LedgerView view(database, version);
  std::vector<Counts> counts(reports.size());
  std::vector<VisitEvidence::ModeLogLikelihood> modes;
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement rows,
      database.Prepare("SELECT report_id, version_id, begin_ns, signature, log_likelihoods "
                       "FROM visit_evidence WHERE area_id = ?1"));
  rows.Bind(area_id);
  for (;;) {
    SHIFTMAP_ASSIGN_OR_RETURN(const bool row, rows.Step());
    if (!row) break;
    const auto report = index_of_id.find(rows.Int64(0));
    if (report == index_of_id.end()) {
      return DataLoss(
          "{}: evidence of report row {}, which is not there", database.name(), rows.Int64(0));
    }
    ++reports[report->second].evidence_rows;
    SHIFTMAP_ASSIGN_OR_RETURN(
        std::optional<SetAside> reason,
        view.JudgeReported(rows.Int64(0), rows.Int64(1), StampFromNanoseconds(rows.Int64(2))));
    if (!reason) {
      if (!UnpackLogLikelihoods(rows.Blob(4), &modes)) {
        return DataLoss("{}: evidence of '{}' is damaged", database.name(), rows.Text(3));
      }
      SHIFTMAP_ASSIGN_OR_RETURN(const std::string_view name,
                                view.NameOf(rows.Blob(3), rows.Int64(1)));
      const auto group = groups.find(std::string(name));
      reason = ReasonOfGroup(group == groups.end() ? nullptr : group->second, modes);
    }
    if (reason) ++counts[report->second][*reason];
  }
  for (std::size_t i = 0; i < reports.size(); ++i) reports[i].set_aside = ToRows(counts[i]);
  return reports;
}

}  // namespace shiftmap
