// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/candidate.h"

#include <fmt/format.h>

#include <set>
#include <utility>

#include "mapper/cli/build_report.h"
#include "mapper/nightly/since_published.h"
#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {

std::string NightKey(const std::vector<LogHead>& logs, const AreaBuildOptions& build) {
  std::set<std::string> runs;
  for (const LogHead& log : logs) runs.insert(log.identity());
  Sha256 hash;
  hash.Update(fmt::format("{} {} {} {} {} {}\n",
                          SoftwareRevision(),
                          build.no_learned_rates,
                          build.limits.max_range_m.value_or(0.0),
                          build.limits.max_speed_mps.value_or(0.0),
                          build.limits.max_yaw_rate_radps.value_or(0.0),
                          build.clock_tolerance_s));
  for (const std::string& run : runs) hash.Update(run + "\n");
  return hash.HexDigest();
}

AreaBuildOptions CandidateBuilder::BuildOptions(const std::vector<LogHead>& logs) const {
  AreaBuildOptions build = options_.build;
  build.area = area_;
  build.starts_anew = true;
  build.night = NightKey(logs, options_.build);
  for (const LogHead& log : logs) build.logs.push_back(log.path);
  return build;
}

StatusOr<std::optional<Candidate>> CandidateBuilder::Find(const std::string& night) const {
  if (!HasStore(options_)) return std::optional<Candidate>();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options_.build.store, MapStore::Access::kReadOnly, context_));
  const StatusOr<std::vector<VersionSummary>> versions = store.Versions(area_);
  if (versions.status().code() == StatusCode::kNotFound) return std::optional<Candidate>();
  if (!versions.ok()) return versions.status();
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(area_, &store));
  for (auto at = versions->rbegin(); at != versions->rend(); ++at) {
    if (at->published || at->created < since.published || !at->content_stored) break;
    SHIFTMAP_ASSIGN_OR_RETURN(Provenance provenance, store.LoadProvenance(area_, at->version));
    BuildOutcome outcome = ReadOutcome(provenance.configuration);
    if (outcome.night != night) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(JudgedVersion version,
                              LoadJudged(area_, *at, std::move(provenance), &store));
    return std::optional(Candidate{std::move(version), std::move(outcome), std::nullopt});
  }
  return std::optional<Candidate>();
}

StatusOr<JudgedVersion> CandidateBuilder::JudgedOf(const AreaBuild& build) const {
  std::optional<MapStore> store;
  if (HasStore(options_)) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        store, OpenStore(options_.build.store, MapStore::Access::kReadOnly, context_));
  }
  return JudgedBuild(area_, build, store ? &*store : nullptr);
}

StatusOr<std::optional<Candidate>> CandidateBuilder::Make(const std::vector<LogHead>& logs,
                                                          std::vector<std::string>* reasons,
                                                          std::vector<UnplacedRun>* waiting,
                                                          bool* for_good) const {
  const AreaBuildOptions options = BuildOptions(logs);
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Candidate> found, Find(options.night));
  if (found) return found;
  StatusOr<AreaBuild> built = MakeAreaBuild(options, context_);
  if (built.status().code() == StatusCode::kCancelled) return built.status();
  *for_good = built.ok() || ExitCodeFor(built.status()) == ExitCode::kBadInput;
  if (!built.ok()) {
    reasons->push_back(Message(built.status()));
    return std::optional<Candidate>();
  }
  if (built->result.runs.empty() || context_.dry_run()) {
    for (const auto& lines :
         {LeftOutLines(built->result), WaitingLines(built->result), built->at_two_places}) {
      reasons->insert(reasons->end(), lines.begin(), lines.end());
    }
    const std::vector<UnplacedRun>& wait = built->commit_options.waiting;
    waiting->insert(waiting->end(), wait.begin(), wait.end());
    return std::optional<Candidate>();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(JudgedVersion version, JudgedOf(*built));
  BuildOutcome outcome = ReadOutcome(version.provenance.configuration);
  return std::optional(Candidate{std::move(version), std::move(outcome), *std::move(built)});
}

StatusOr<std::optional<JudgedVersion>> CandidateBuilder::BuildFold(
    const std::vector<LogHead>& logs) const {
  const StatusOr<AreaBuild> built = MakeAreaBuild(BuildOptions(logs), context_);
  if (built.status().code() == StatusCode::kCancelled) return built.status();
  if (!built.ok() || built->result.runs.empty()) return std::optional<JudgedVersion>();
  SHIFTMAP_ASSIGN_OR_RETURN(JudgedVersion version, JudgedOf(*built));
  return std::optional(std::move(version));
}

}  // namespace shiftmap
