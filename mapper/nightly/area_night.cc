// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/area_night.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>
#include <utility>

#include "mapper/cli/build_report.h"
#include "mapper/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/cli/version.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

// Builds of one area in one night at most: each further one is without runs that were held.
constexpr int kMaxBuilds = 6;

Status CheckStopped() {
  if (StopSignals::Received().empty()) return OkStatus();
  return MakeStatus(StatusCode::kCancelled, "night stopped by {}", StopSignals::Received());
}

// Since the version that is published now became so.
struct SincePublished {
  Stamp published = Stamp::min();
  std::map<std::string, std::string> refused;  // Reasons by version number.
  std::set<std::string> included;              // Subjects of "include", of the whole past.
};

StatusOr<SincePublished> ReadSincePublished(const std::string& area, MapStore* store) {
  SincePublished since;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AuditEntry> audit, store->AuditLog(area));
  for (const AuditEntry& entry : audit) {
    if (entry.action == "publish" || entry.action == "rollback") {
      since.published = entry.written;
      since.refused.clear();
    } else if (entry.action == "refuse") {
      const std::size_t blank = entry.subject.find(' ');
      since.refused[entry.subject.substr(0, blank)] =
          blank == std::string::npos ? "" : entry.subject.substr(blank + 1);
    } else if (entry.action == "include") {
      since.included.insert(entry.subject.substr(0, entry.subject.find(": ")));
    }
  }
  return since;
}

// A version that waits to be judged or published.
struct Candidate {
  VersionNumber version;
  std::string content_hash;
  BuildOutcome outcome;
  std::set<std::string> runs;  // Identities and hashes.

  bool Has(const LogHead& log) const {
    return runs.contains(log.identity()) || runs.contains(log.sha256);
  }
};

class Area {
 public:
  Area(const NightOptions& options, const std::string& area, const AreaLogs& logs, Context* context)
      : options_(options), logs_(logs), context_(*context) {
    night_.area = area;
    night_.runs_new = logs.fresh.size();
  }

  StatusOr<AreaNight> Run();

 private:
  StatusOr<MapStore> Open(MapStore::Access access) const {
    return OpenStore(options_.build.store, access, context_, options_.build.clock_tolerance_s);
  }
  Status HoldOut();
  StatusOr<std::optional<Candidate>> FindCandidate(const std::string& night) const;
  StatusOr<std::optional<Candidate>> MakeCandidate(const std::vector<LogHead>& given);
  StatusOr<Judgement> JudgeCandidate(const Candidate& candidate,
                                     const std::vector<LogHead>& given) const;
  Status Hold(const LogHead& log, const std::string& reason);
  StatusOr<bool> HoldSuspects(const Judgement& judgement, std::vector<LogHead>* given);
  StatusOr<bool> BuildWithoutWorst(const Judgement& judgement, const std::vector<LogHead>& given);
  Status Publish(const Candidate& candidate);
  Status Refuse(const Candidate& candidate, const Judgement& judgement);
  StatusOr<bool> LeaveOut(const Candidate& candidate);
  void Say(const std::string& line);
  void Take(const Candidate& candidate) {
    night_.version = candidate.version;
    night_.content_hash = candidate.content_hash;
  }

  const NightOptions& options_;
  const AreaLogs& logs_;
  Context& context_;
  std::vector<LogHead> held_out_;
  std::vector<LogHead> given_;
  AreaNight night_;
};

// Every other night another share of the runs, the same at each start of one.
Status Area::HoldOut() {
  given_ = logs_.fresh;
  const std::size_t count =
      given_.size() * static_cast<std::size_t>(options_.hold_out_percent) / 100;
  std::error_code error;
  if (count > 0 && std::filesystem::exists(options_.build.store, error)) {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
    SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(night_.area));
    if (published) {
      std::map<std::string, LogHead> by_lot;
      for (const LogHead& log : given_) {
        Sha256 hash;
        hash.Update(fmt::format("{} {}", published->value(), log.identity()));
        by_lot.emplace(hash.HexDigest() + log.path, log);
      }
      given_.clear();
      for (auto& [lot, log] : by_lot) {
        (held_out_.size() < count ? held_out_ : given_).push_back(log);
      }
    }
  }
  night_.held_out = held_out_.size();
  for (const std::vector<LogHead>* const kind : {&logs_.waiting, &logs_.again}) {
    given_.insert(given_.end(), kind->begin(), kind->end());
  }
  return OkStatus();
}

StatusOr<std::optional<Candidate>> Area::FindCandidate(const std::string& night) const {
  std::error_code error;
  if (!std::filesystem::exists(options_.build.store, error)) return std::optional<Candidate>();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  const StatusOr<std::vector<VersionSummary>> versions = store.Versions(night_.area);
  if (versions.status().code() == StatusCode::kNotFound) return std::optional<Candidate>();
  if (!versions.ok()) return versions.status();
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(night_.area, &store));
  for (auto at = versions->rbegin(); at != versions->rend(); ++at) {
    if (at->published || at->created < since.published || !at->content_stored) break;
    SHIFTMAP_ASSIGN_OR_RETURN(const Provenance provenance,
                              store.LoadProvenance(night_.area, at->version));
    BuildOutcome outcome = ReadOutcome(provenance.configuration);
    if (outcome.night != night) continue;
    Candidate candidate{at->version, at->content_hash, std::move(outcome), {}};
    for (const RunRecord& run : provenance.runs) {
      candidate.runs.insert(run.identity());
      candidate.runs.insert(run.sha256);
    }
    return std::optional(std::move(candidate));
  }
  return std::optional<Candidate>();
}

// Nothing if there is no version; the reasons then say why.
StatusOr<std::optional<Candidate>> Area::MakeCandidate(const std::vector<LogHead>& given) {
  const std::string night = NightKey(given, options_.build);
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Candidate> found, FindCandidate(night));
  if (found) return found;
  AreaBuildOptions build = options_.build;
  build.area = night_.area;
  build.night = night;
  build.no_publish = true;
  for (const LogHead& log : given) build.logs.push_back(log.path);
  const StatusOr<AreaBuild> built = BuildArea(build, context_);
  if (built.status().code() == StatusCode::kCancelled) return built.status();
  if (!built.ok()) {
    night_.reasons.push_back(Message(built.status()));
    return std::optional<Candidate>();
  }
  if (!built->commit) {
    for (const auto& lines : {LeftOutLines(built->result), WaitingLines(built->result)}) {
      night_.reasons.insert(night_.reasons.end(), lines.begin(), lines.end());
    }
    return std::optional<Candidate>();
  }
  return FindCandidate(night);
}

StatusOr<Judgement> Area::JudgeCandidate(const Candidate& candidate,
                                         const std::vector<LogHead>& given) const {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  return Judge(night_.area,
               candidate.version,
               {given, held_out_, logs_.mapped},
               options_.judge,
               &store,
               CheckStopped);
}

// A run that somebody took in again by hand is not held any more.
Status Area::Hold(const LogHead& log, const std::string& reason) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  Exclusion hold;
  hold.run = log.identity();
  hold.reason = "nightly: " + reason;
  hold.held = true;
  const Status held = store.Exclude(night_.area, hold);
  if (!held.ok() && held.code() != StatusCode::kAlreadyExists) return held;
  night_.reasons.push_back(fmt::format(
      "'{}' is left out of the map and held: {}; to decide: shiftmap-inspect runs include {}, or "
      "exclude",
      log.path,
      reason,
      log.identity()));
  return OkStatus();
}

// Whether any run was held. They are no more among those given.
StatusOr<bool> Area::HoldSuspects(const Judgement& judgement, std::vector<LogHead>* given) {
  if (judgement.suspects.empty()) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(night_.area, &store));
  bool any = false;
  for (const Judgement::Suspect& suspect : judgement.suspects) {
    const auto log = std::find_if(
        given->begin(), given->end(), [&](const LogHead& of) { return of.path == suspect.path; });
    if (log == given->end() || since.included.contains("run " + log->identity())) continue;
    SHIFTMAP_RETURN_IF_ERROR(Hold(*log, suspect.reason));
    given->erase(log);
    any = true;
  }
  return any;
}

// The vehicle whose runs fit the old map worst is to blame if the map without them is not worse.
// Whether it was, and that map is published.
StatusOr<bool> Area::BuildWithoutWorst(const Judgement& judgement,
                                       const std::vector<LogHead>& given) {
  std::string worst;
  double most = -1.0;
  for (const JudgedShift& shift : judgement.shifts) {
    if (!shift.in_build || !shift.before) continue;
    const double misfit =
        std::log(std::max(1.0, shift.before->nis_per_dof())) + shift.before->doubt_share();
    if (misfit <= most) continue;
    most = misfit;
    worst = shift.vehicle;
  }
  std::vector<LogHead> without = given;
  std::vector<LogHead> blamed;
  std::erase_if(without, [&](const LogHead& log) {
    if (log.info.vehicle != worst) return false;
    blamed.push_back(log);
    return true;
  });
  if (without.empty() || blamed.empty()) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<Candidate> candidate, MakeCandidate(without));
  if (!candidate) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(Judgement again, JudgeCandidate(*candidate, without));
  if (!again.worse.empty() || !again.suspects.empty()) return false;
  for (const LogHead& log : blamed) {
    SHIFTMAP_RETURN_IF_ERROR(
        Hold(log, "the map with it is worse for others: " + judgement.worse.front()));
  }
  night_.judgement = std::move(again);
  SHIFTMAP_RETURN_IF_ERROR(Publish(*candidate));
  return true;
}

void Area::Say(const std::string& line) {
  const std::vector<std::string>& said = night_.reasons;
  if (std::find(said.begin(), said.end(), line) == said.end()) night_.reasons.push_back(line);
}

// What a build does not take has no part in its map either: it is built again without. Whether
// there was any.
StatusOr<bool> Area::LeaveOut(const Candidate& candidate) {
  std::vector<LogHead> out;
  std::erase_if(given_, [&](const LogHead& log) {
    if (candidate.Has(log)) return false;
    out.push_back(log);
    return true;
  });
  for (const std::string& line : candidate.outcome.left_out) {
    const auto log = std::find_if(out.begin(), out.end(), [&](const LogHead& of) {
      const std::string stem = std::filesystem::path(of.path).stem().string();
      return line.starts_with(fmt::format("run '{}' ", stem));
    });
    if (log == out.end()) {
      Say(line);
      continue;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string hash, HashFile(log->path));
    Say(fmt::format("{}; to ignore it: shiftmap-inspect runs exclude {}", line, hash));
  }
  for (const std::string& line : candidate.outcome.waiting) Say(line);
  night_.runs_waiting = std::max(night_.runs_waiting, candidate.outcome.waiting.size());
  return !out.empty();
}

Status Area::Publish(const Candidate& candidate) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(night_.area));
  const Status status = store.Publish(night_.area, candidate.version, published);
  if (!status.ok() && status.code() != StatusCode::kAlreadyExists) return status;
  Take(candidate);
  night_.published = true;
  return OkStatus();
}

Status Area::Refuse(const Candidate& candidate, const Judgement& judgement) {
  Take(candidate);
  const std::string reasons = fmt::format("{}", fmt::join(judgement.worse, "; "));
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  return store.AddNote(
      night_.area, NightNote::kRefused, fmt::format("{} {}", candidate.version.value(), reasons));
}

StatusOr<AreaNight> Area::Run() {
  SHIFTMAP_RETURN_IF_ERROR(HoldOut());
  for (int build = 0; build < kMaxBuilds && !given_.empty(); ++build) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<Candidate> candidate, MakeCandidate(given_));
    if (!candidate) break;
    SHIFTMAP_ASSIGN_OR_RETURN(const bool less, LeaveOut(*candidate));
    if (less) continue;
    if (options_.no_judge) {
      SHIFTMAP_RETURN_IF_ERROR(Publish(*candidate));
      break;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
    SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since, ReadSincePublished(night_.area, &store));
    if (since.refused.contains(std::to_string(candidate->version.value()))) {
      Take(*candidate);
      break;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(Judgement judgement, JudgeCandidate(*candidate, given_));
    SHIFTMAP_ASSIGN_OR_RETURN(const bool held, HoldSuspects(judgement, &given_));
    if (held) continue;
    night_.judgement = judgement;
    if (judgement.worse.empty()) {
      SHIFTMAP_RETURN_IF_ERROR(Publish(*candidate));
      break;
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const bool done, BuildWithoutWorst(judgement, given_));
    if (!done) SHIFTMAP_RETURN_IF_ERROR(Refuse(*candidate, judgement));
    break;
  }
  return night_;
}

}  // namespace

std::string NightKey(const std::vector<LogHead>& logs, const AreaBuildOptions& build) {
  std::set<std::string> runs;
  for (const LogHead& log : logs) runs.insert(log.identity());
  Sha256 hash;
  hash.Update(SoftwareRevision() + (build.no_learned_rates ? " default\n" : " learned\n"));
  for (const std::string& run : runs) hash.Update(run + "\n");
  return hash.HexDigest();
}

StatusOr<AreaNight> RunAreaNight(const NightOptions& options,
                                 const std::string& area,
                                 const AreaLogs& logs,
                                 Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(AreaNight night, Area(options, area, logs, &context).Run());
  std::error_code error;
  if (!std::filesystem::exists(options.build.store, error)) return night;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.build.store, MapStore::Access::kReadOnly, context));
  const StatusOr<SincePublished> since = ReadSincePublished(area, &store);
  if (since.status().code() == StatusCode::kNotFound) return night;
  if (!since.ok()) return since.status();
  night.refused_in_a_row = static_cast<int>(since->refused.size());
  if (night.version && !night.published) {
    const auto refused = since->refused.find(std::to_string(night.version->value()));
    if (refused != since->refused.end()) {
      night.reasons.insert(
          night.reasons.begin(),
          fmt::format("version {} is not published: {}; to take it all the same: shiftmap-inspect "
                      "publish {}",
                      refused->first,
                      refused->second,
                      refused->first));
    }
  }
  if (night.alarm()) {
    night.reasons.insert(
        night.reasons.begin(),
        fmt::format("alarm: {} versions in a row were not published", night.refused_in_a_row));
  }
  return night;
}

}  // namespace shiftmap
