// SPDX-License-Identifier: Apache-2.0
#include "mapstore/store/mapped_rows.h"

#include <algorithm>
#include <string>
#include <unordered_map>

#include "mapstore/map/shift_report_check.h"
#include "mapstore/sqlite/row_checksum.h"
#include "mapstore/store/blob.h"

namespace shiftmap {
namespace {

// Log-likelihoods are differences of large sums.
constexpr double kRounding = 1e-6;

Status CheckVisit(const RunRecord& run, const VisitEvidence& visit, const LandmarkGroup* group) {
  const auto refuse = [&](const char* problem) {
    return InvalidArgument(
        "run '{}': evidence of '{}': {}", run.name, visit.signature.text(), problem);
  };
  if (group == nullptr) return refuse("the map does not have it");
  if (visit.begin > visit.end || visit.begin < run.begin || visit.end > run.end) {
    return refuse("its visit is not within the run");
  }
  if (!CheckLogLikelihoods(visit.modes)) return refuse("expected finite values, `absent` first");
  double least = visit.modes.front().log_likelihood;
  double largest = least;
  for (const VisitEvidence::ModeLogLikelihood& mode : visit.modes) {
    if (group->StateOf(mode.mode) < 0) return refuse("of a mode that the map does not have");
    least = std::min(least, mode.log_likelihood);
    largest = std::max(largest, mode.log_likelihood);
  }
  if (largest - least > kMaxVisitLogRatio + kRounding) return refuse("values too far apart");
  return visit.observations >= 0 ? OkStatus() : refuse("fewer than 0 observations");
}

}  // namespace

Status CheckRunEvidence(const std::vector<RunRecord>& runs, const MapContent& content) {
  std::unordered_map<Signature, const LandmarkGroup*> groups;
  for (const LandmarkGroup& group : content.groups) groups.emplace(group.signature, &group);
  for (const RunRecord& run : runs) {
    for (const VisitEvidence& visit : run.evidence) {
      const auto group = groups.find(visit.signature);
      SHIFTMAP_RETURN_IF_ERROR(
          CheckVisit(run, visit, group == groups.end() ? nullptr : group->second));
    }
  }
  return OkStatus();
}

Status InsertMappedEvidence(Database& database,
                            std::int64_t area_id,
                            std::int64_t version_id,
                            std::int64_t run_id,
                            const std::vector<VisitEvidence>& evidence) {
  SHIFTMAP_ASSIGN_OR_RETURN(
      Statement row,
      database.Prepare(InsertRowSql("mapped_evidence",
                                    "area_id, begin_ns, end_ns, version_id, run_id, signature, "
                                    "observation_count, log_likelihoods")));
  for (const VisitEvidence& visit : evidence) {
    const std::string log_likelihoods = PackLogLikelihoods(visit.modes);
    row.Bind(area_id,
             ToNanoseconds(visit.begin),
             ToNanoseconds(visit.end),
             version_id,
             run_id,
             visit.signature.text(),
             visit.observations,
             BlobView{log_likelihoods});
    SHIFTMAP_RETURN_IF_ERROR(row.Execute());
  }
  return OkStatus();
}

}  // namespace shiftmap
