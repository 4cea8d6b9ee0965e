// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/area_logs.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "mapper/cli/log_file.h"
#include "mapper/cli/run_copies.h"
#include "mapper/nightly/rolled_back.h"
#include "mapper/nightly/since_published.h"
#include "mapstore/codec/run_log.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/sha256.h"
#include "mapstore/prior_version.h"

namespace shiftmap {
namespace {

constexpr std::size_t kSha256Digits = 64;

// What the store says of an area's runs.
struct KnownRuns {
  std::set<std::string> mapped;
  std::optional<VersionNumber> prior;  // What a build goes on from.
  std::vector<LineRun> kept;           // In it.
  std::vector<UnplacedRun> waiting;

  // What versions mapped that somebody rolled back, and the version.
  std::map<std::string, VersionNumber> rolled_back;
  std::vector<Exclusion> exclusions;
};

StatusOr<KnownRuns> ReadKnownRuns(const std::string& area, MapStore* store) {
  KnownRuns known;
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store->PublishedVersion(area));
  const StatusOr<std::vector<Exclusion>> exclusions = store->Exclusions(area);
  if (exclusions.status().code() == StatusCode::kNotFound) return known;
  if (!exclusions.ok()) return exclusions.status();
  known.exclusions = *exclusions;
  SHIFTMAP_ASSIGN_OR_RETURN(known.waiting, store->WaitingRuns(area));
  if (!published) return known;
  SHIFTMAP_ASSIGN_OR_RETURN(known.mapped, store->RunIdentities(area, *published));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VersionSummary> versions, store->Versions(area));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> audit,
                            store->AuditLog(area, {AuditAction::kPublish, AuditAction::kRollback}));
  for (const VersionNumber version : RolledBackVersions(versions, audit)) {
    SHIFTMAP_ASSIGN_OR_RETURN(const auto identities, store->RunIdentities(area, version));
    for (const std::string& run : identities) known.rolled_back.emplace(run, version);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(known.prior, FindPriorVersion(area, *published, nullptr, store));
  if (!known.prior) return known;
  SHIFTMAP_ASSIGN_OR_RETURN(known.kept, store->LineRuns(area, *known.prior));
  return known;
}

// Whether a log is out of all builds by somebody's decision.
bool Remove(const KnownRuns& known, const std::string& run, const LogHead& log, AreaLogs* sorted) {
  const Exclusion* const exclusion =
      FindExclusion(known.exclusions, run, "", log.info.vehicle, log.begin);
  if (exclusion == nullptr) return false;
  if (exclusion->held) {
    sorted->held.push_back(
        fmt::format("'{}' is held: {}; to decide: shiftmap-inspect runs include {}, or exclude",
                    log.path,
                    exclusion->reason,
                    exclusion->vehicle.empty() ? exclusion->run
                                               : fmt::format("--vehicle {}", exclusion->vehicle)));
  } else {
    sorted->excluded.push_back(log);
  }
  return true;
}

// The run of the map that a log is of, or null.
StatusOr<const LineRun*> MappedRunOf(const std::string& area,
                                     const KnownRuns& known,
                                     const LogHead& log,
                                     MapStore* store) {
  const auto is_log_of = [&](const LineRun& like) -> StatusOr<bool> {
    const StatusOr<RunLog> read = ReadRunLog(log.path, {.lidar_scans = false});
    if (!read.ok()) return false;  // The build says so.
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows,
                              store->Evidence(area, *known.prior));
    return IsLogOf(read->run, like.run, rows);
  };
  return FindMappedRun(known.kept, log.info, log.sha256, log.begin, is_log_of);
}

// What the map lacks of a log that it has a run of, for a line about it; nothing if it lacks
// nothing. A file that is as it was when its run was mapped need not be read.
StatusOr<std::optional<std::string>> Rest(const std::string& area,
                                          const LineRun& mapped,
                                          LogHead* log,
                                          MapStore* store) {
  const std::optional<Stamp> changed = ChangedAt(log->path);
  const bool same_vehicle = log->info.vehicle == mapped.run.vehicle;
  if (!log->info.uuid.empty() && same_vehicle && changed && *changed < mapped.committed) {
    return std::optional<std::string>();
  }
  if (log->sha256.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(log->sha256, HashFile(log->path));
  }
  if (log->sha256 == mapped.run.sha256) return std::optional<std::string>();
  const StatusOr<RunLog> read = ReadRunLog(log->path, {.lidar_scans = false});
  if (!read.ok()) return std::optional<std::string>();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> rest,
                            MissingRest(area, mapped, read->run, store));
  if (!rest) return rest;
  return std::optional(
      fmt::format("'{}' is left out: {}; to leave it so, delete the log", log->path, *rest));
}

// Somebody has to decide about a run that waits and is not given, unless it is excluded.
void NameNotGiven(const KnownRuns& known, const std::set<std::string>& given, AreaLogs* sorted) {
  for (const UnplacedRun& run : known.waiting) {
    const Exclusion* const exclusion = FindExclusion(known.exclusions, run.sha256, "", "", Stamp());
    if (given.contains(run.sha256) || (exclusion != nullptr && !exclusion->held)) continue;
    sorted->held.push_back(
        fmt::format("run '{}' waits since {} UTC, and its log is not there; without it: "
                    "shiftmap-inspect runs exclude {}",
                    InertLine(run.name),
                    FormatUtc(run.since),
                    run.sha256));
  }
}

}  // namespace

StatusOr<AreaLogs> SortLogs(const std::string& area, std::vector<LogHead> logs, MapStore* store) {
  KnownRuns known;
  if (store != nullptr) {
    SHIFTMAP_ASSIGN_OR_RETURN(known, ReadKnownRuns(area, store));
  }
  // A log that has a UUID may be known by its hash, which takes a reading of the whole file.
  const bool by_hash = !known.waiting.empty() ||
                       std::any_of(known.exclusions.begin(),
                                   known.exclusions.end(),
                                   [](const auto& of) { return of.run.size() == kSha256Digits; });
  AreaLogs sorted;
  std::set<std::string> waiting;
  for (const UnplacedRun& run : known.waiting) waiting.insert(run.sha256);
  std::set<std::string> given;
  for (LogHead& log : logs) {
    if (Remove(known, log.identity(), log, &sorted)) {
      // Its hash is for the runs that wait.
      if (!waiting.empty()) given.insert(HashFile(log.path).value_or(log.sha256));
      continue;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const LineRun* const mapped, MappedRunOf(area, known, log, store));
    if (mapped != nullptr) {
      SHIFTMAP_ASSIGN_OR_RETURN(std::optional<std::string> rest, Rest(area, *mapped, &log, store));
      if (rest) {
        sorted.held.push_back(*std::move(rest));
      } else {
        sorted.mapped.push_back(std::move(log));
      }
      continue;
    }
    if (by_hash && log.sha256.empty()) {
      SHIFTMAP_ASSIGN_OR_RETURN(log.sha256, HashFile(log.path));
    }
    given.insert(log.sha256);
    if (by_hash && Remove(known, log.sha256, log, &sorted)) continue;
    const bool again = known.mapped.contains(log.identity());
    const auto back = known.rolled_back.find(log.identity());
    if (!again && back != known.rolled_back.end()) {
      SHIFTMAP_ASSIGN_OR_RETURN(const std::string publish,
                                PublishCommand(area, back->second, store));
      sorted.held.push_back(
          fmt::format("'{}' was mapped by version {}, which somebody rolled back; to decide: "
                      "shiftmap-inspect runs exclude {}, {}, or build with it by hand",
                      log.path,
                      back->second.value(),
                      log.identity(),
                      publish));
      continue;
    }
    std::vector<LogHead>& kind = again                          ? sorted.again
                                 : waiting.contains(log.sha256) ? sorted.waiting
                                                                : sorted.fresh;
    kind.push_back(std::move(log));
  }
  NameNotGiven(known, given, &sorted);
  return sorted;
}

}  // namespace shiftmap
