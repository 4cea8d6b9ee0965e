// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/run_copies.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstddef>

#include "mapstore/core/clock.h"

namespace shiftmap {

bool AreCopies(const Run& a, const Run& b) {
  if (!a.info.uuid.empty() && !b.info.uuid.empty()) return a.info.uuid == b.info.uuid;
  const std::size_t count = std::min(a.odometry.size(), b.odometry.size());
  return a.info.vehicle == b.info.vehicle &&
         std::equal(a.odometry.begin(),
                    a.odometry.begin() + static_cast<std::ptrdiff_t>(count),
                    b.odometry.begin(),
                    [](const OdometrySample& of_a, const OdometrySample& of_b) {
                      return of_a.stamp == of_b.stamp && of_a.v_mps == of_b.v_mps &&
                             of_a.omega_radps == of_b.omega_radps;
                    });
}

StatusOr<const LineRun*> FindMappedRun(
    const std::vector<LineRun>& runs,
    const RunInfo& info,
    const std::string& sha256,
    Stamp begin,
    const std::function<StatusOr<bool>(const LineRun& run)>& saw_visits) {
  const auto find = [&](const auto& is_wanted) {
    const auto found = std::find_if(
        runs.begin(), runs.end(), [&](const LineRun& of) { return is_wanted(of.run); });
    return found == runs.end() ? nullptr : &*found;
  };
  const LineRun* const mapped = find([&](const RunRecord& run) {
    return run.sha256 == sha256 || (!info.uuid.empty() && run.uuid == info.uuid);
  });
  if (mapped != nullptr) return mapped;
  const LineRun* const like = find([&](const RunRecord& run) {
    return (info.uuid.empty() || run.uuid.empty()) && run.vehicle == info.vehicle &&
           run.begin == begin;
  });
  if (like == nullptr) return like;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool saw, saw_visits(*like));
  return saw ? like : nullptr;
}

bool SawVisits(const Run& run, const std::string& source, const std::vector<EvidenceRow>& rows) {
  const auto saw = [&](const Signature& signature, Stamp stamp) {
    const auto scan = std::lower_bound(
        run.scans.begin(), run.scans.end(), stamp, [](const Scan& of, Stamp wanted) {
          return of.stamp < wanted;
        });
    return scan != run.scans.end() && scan->stamp == stamp &&
           std::any_of(scan->observations.begin(), scan->observations.end(), [&](const auto& of) {
             return of.signature == signature;
           });
  };
  int visits = 0;
  int seen = 0;
  for (const auto& [of_source, visit, vehicle] : rows) {
    if (of_source != source || visit.observations == 0 || visit.end > EndOf(run)) continue;
    ++visits;
    seen += saw(visit.signature, visit.begin) && saw(visit.signature, visit.end) ? 1 : 0;
  }
  return 2 * seen > visits;
}

std::optional<std::string> MissingRest(const LineRun& mapped, Stamp end) {
  if (end <= mapped.run.end) return std::nullopt;
  return fmt::format(
      "version {} was built from a shorter copy of it, which ends at {} UTC; to map all of it: "
      "shiftmap-inspect rollback to before version {}, then shiftmap-mapper build with it",
      mapped.version.value(),
      FormatUtc(mapped.run.end),
      mapped.version.value());
}

}  // namespace shiftmap
