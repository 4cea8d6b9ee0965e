// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/log_area.h"

#include <fmt/format.h>

#include <algorithm>
#include <set>

#include "mapper/nightly/replay.h"
#include "mapstore/codec/run_log.h"

namespace shiftmap {
namespace {

constexpr int kMinLandmarks = 3;   // That log and map have in common: two fit by accident.
constexpr double kMostLost = 0.5;  // Share of its time that a log of the map may be LOST.

std::set<Signature> SignaturesOf(const Run& run) {
  std::set<Signature> signatures;
  for (const Scan& scan : run.scans) {
    for (const Observation& observation : scan.observations) {
      if (!observation.signature.anonymous()) signatures.insert(observation.signature);
    }
  }
  return signatures;
}

}  // namespace

StatusOr<LogAreas> LocateLog(const LogHead& log,
                             MapStore* store,
                             const std::function<Status()>& on_step) {
  LogAreas areas;
  SHIFTMAP_ASSIGN_OR_RETURN(const RunLog read, ReadRunLog(log.path, {.lidar_scans = false}));
  const std::set<Signature> seen = SignaturesOf(read.run);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> all, store->Areas());
  for (const AreaSummary& area : all) {
    if (!area.published) continue;
    ++areas.asked;
    SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map,
                              store->LoadAt(area.area, std::nullopt, log.begin));
    const auto known = std::count_if(seen.begin(), seen.end(), [&](const Signature& signature) {
      return map.GroupIndex(signature) >= 0;
    });
    if (known < kMinLandmarks) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(const ShiftScore score, Replay(read.run, map, {}, on_step));
    if (score.dof > 0 && score.lost_share() <= kMostLost) areas.fit.push_back(area.area);
  }
  return areas;
}

std::string LocatedSubject(const std::string& run, const LogAreas& areas) {
  if (areas.fit.size() == 1) return fmt::format("{} {} one {}", run, areas.asked, areas.fit[0]);
  return fmt::format("{} {} {}", run, areas.asked, areas.fit.empty() ? "none" : "several");
}

std::optional<LogAreas> KnownAreas(const std::string& run,
                                   int published_areas,
                                   const std::vector<AuditEntry>& audit) {
  // The newest.
  const auto entry = std::find_if(audit.rbegin(), audit.rend(), [&](const AuditEntry& of) {
    return of.Is(AuditAction::kLocate) && of.subject.starts_with(run + " ");
  });
  if (entry == audit.rend()) return std::nullopt;
  const std::string rest = entry->subject.substr(run.size() + 1);
  const std::size_t blank = rest.find(' ');
  if (blank == std::string::npos) return std::nullopt;
  const std::string verdict = rest.substr(blank + 1);
  LogAreas areas{published_areas, {}, true};
  if (verdict.starts_with("one ")) {
    areas.fit = {verdict.substr(4)};
    return areas;
  }
  if (rest.substr(0, blank) != std::to_string(published_areas)) return std::nullopt;
  if (verdict == "several") areas.fit = {"", ""};
  return areas;
}

}  // namespace shiftmap
