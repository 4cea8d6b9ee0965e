// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/area_night.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "mapper/cli/area_build.h"
#include "mapper/cli/log_file.h"
#include "mapper/cli/objections.h"
#include "mapper/nightly/candidate.h"
#include "mapper/nightly/left_out.h"
#include "mapper/nightly/refused_versions.h"
#include "mapper/nightly/since_published.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

// Builds of one area in one night at most: each further one is without runs that were held.
constexpr int kMaxBuilds = 6;

Status CheckStopped() {
  if (StopSignals::Received().empty()) return OkStatus();
  return MakeStatus(StatusCode::kCancelled, "night stopped by {}", StopSignals::Received());
}

bool Has(const std::vector<LogHead>& logs, const LogHead& log) {
  return std::any_of(
      logs.begin(), logs.end(), [&](const LogHead& of) { return of.path == log.path; });
}

class Area {
 public:
  Area(const NightOptions& options, const std::string& area, const AreaLogs& logs, Context* context)
      : options_(options), logs_(logs), context_(*context), candidates_(options, area, context) {
    night_.area = area;
    night_.runs_new = logs.fresh.size();
  }

  StatusOr<AreaNight> Run();

 private:
  enum class Step { kDone, kAgain };

  StatusOr<MapStore> Open(MapStore::Access access) const {
    return OpenStore(options_.build.store, access, context_, options_.build.clock_tolerance_s);
  }
  Status HoldOut();
  Status SkipLeftOut();
  StatusOr<Judgement> JudgeCandidate(const Candidate& candidate,
                                     const std::vector<LogHead>& given) const;
  Status CheckUpToDate(const Candidate& candidate) const;
  StatusOr<std::vector<std::string>> Objections(const Candidate& candidate) const;
  Status Hold(const LogHead& log, const std::string& reason);
  StatusOr<bool> HoldSuspects(const Judgement& judgement, std::vector<LogHead>* given);
  StatusOr<bool> BuildWithout(const std::function<bool(const LogHead&)>& blames,
                              const Judgement& judgement,
                              const std::vector<LogHead>& given);
  StatusOr<bool> BuildWithoutWorst(const Judgement& judgement, const std::vector<LogHead>& given);
  Status WriteHolds();
  Status DropExcluded();
  Status NoteWaiting();
  Status NoteLeftOut();
  Status Commit(bool publish, Candidate* candidate);
  Status Publish(Candidate* candidate);
  Status Refuse(const std::vector<std::string>& reasons, Candidate* candidate);
  StatusOr<bool> LeaveOut(const Candidate& candidate);
  StatusOr<Step> Build();
  void Say(const std::string& line);
  void Take(const Candidate& candidate);

  const NightOptions& options_;
  const AreaLogs& logs_;
  Context& context_;
  const CandidateBuilder candidates_;
  std::vector<LogHead> held_out_;
  std::vector<LogHead> given_;
  std::vector<LogHead> asked_;          // As given at first, but for those that were held.
  std::set<std::string> left_out_;      // Of them, by identity,
  std::set<std::string> left_earlier_;  // and in an earlier night.
  std::vector<UnplacedRun> waiting_;    // Of builds that were made anew without them.
  std::vector<Exclusion> holds_;        // Of an area that the store does not have yet.
  AreaNight night_;
};

// Every other night another share of the runs, the same at each start of one.
Status Area::HoldOut() {
  given_ = logs_.fresh;
  const std::size_t count =
      given_.size() * static_cast<std::size_t>(options_.hold_out_percent) / 100;
  if (count > 0 && HasStore(options_)) {
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
  asked_ = given_;
  return SkipLeftOut();
}

// Without new logs a build would leave out again what one before has left out.
Status Area::SkipLeftOut() {
  if (!logs_.fresh.empty() || !HasStore(options_)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(left_earlier_, ReadLeftOut(options_, night_.area, asked_, &store));
  left_out_ = left_earlier_;
  std::erase_if(given_, [&](const LogHead& log) { return left_earlier_.contains(log.identity()); });
  // What waits alone is not built either.
  if (given_.size() < asked_.size() &&
      std::none_of(
          given_.begin(), given_.end(), [&](const LogHead& log) { return Has(logs_.again, log); }))
    given_.clear();
  for (const LogHead& log : asked_) {
    if (Has(given_, log)) continue;
    Say(Has(logs_.waiting, log)
            ? fmt::format("'{}' waits", log.path)
            : fmt::format("'{}' is left out as in an earlier night, since nothing has changed: "
                          "shiftmap-mapper build tries it, shiftmap-inspect runs exclude {} ends "
                          "this line",
                          log.path,
                          log.identity()));
  }
  return OkStatus();
}

StatusOr<Judgement> Area::JudgeCandidate(const Candidate& candidate,
                                         const std::vector<LogHead>& given) const {
  std::optional<MapStore> store;
  JudgedLogs logs{given, held_out_, logs_.mapped};
  if (candidate.version.parent) {
    SHIFTMAP_ASSIGN_OR_RETURN(store, Open(MapStore::Access::kReadOnly));
    SHIFTMAP_ASSIGN_OR_RETURN(logs.refused, ReadRefused(night_.area, &*store));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(
      Judgement judgement,
      Judge(
          night_.area,
          candidate.version,
          logs,
          options_.judge,
          [this](const std::vector<LogHead>& some) { return candidates_.BuildFold(some); },
          store ? &*store : nullptr,
          CheckStopped));
  SHIFTMAP_RETURN_IF_ERROR(CheckUpToDate(candidate));
  // It is not for shifts to judge whether the map is worth these.
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> objections, Objections(candidate));
  judgement.worse.insert(judgement.worse.end(), objections.begin(), objections.end());
  return judgement;
}

// A version or an edit that somebody published since a build began makes the build out of date:
// judged all the same, innocent runs would be held for what it lacks.
// Errors: kAborted.
Status Area::CheckUpToDate(const Candidate& candidate) const {
  if (!candidate.build || !HasStore(options_)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(night_.area));
  if (published == candidate.build->commit_options.expected) return OkStatus();
  return MakeStatus(StatusCode::kAborted,
                    "area '{}': another version was published since the build began",
                    night_.area);
}

// A build has asked already. What is decided since makes another version the published one, so that
// it is built anew.
StatusOr<std::vector<std::string>> Area::Objections(const Candidate& candidate) const {
  if (candidate.build) return candidate.build->objections;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  const JudgedVersion& version = candidate.version;
  return FindObjections(
      night_.area, version.parent, version.provenance.runs, version.map.content(), &store);
}

// A run that somebody took in again by hand is not held any more.
Status Area::Hold(const LogHead& log, const std::string& reason) {
  Exclusion hold;
  hold.run = log.identity();
  hold.reason = "nightly: " + reason;
  hold.held = true;
  holds_.push_back(std::move(hold));
  std::erase_if(asked_, [&](const LogHead& of) { return of.path == log.path; });
  SHIFTMAP_RETURN_IF_ERROR(WriteHolds());
  night_.reasons.push_back(fmt::format(
      "'{}' is left out of the map and held: {}; to decide: shiftmap-inspect runs include {}, or "
      "exclude",
      log.path,
      reason,
      log.identity()));
  return OkStatus();
}

// As soon as the store has the area.
Status Area::WriteHolds() {
  if (holds_.empty() || !HasStore(options_)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  const bool known = std::any_of(areas.begin(), areas.end(), [&](const AreaSummary& area) {
    return area.area == night_.area;
  });
  if (!known) return OkStatus();
  for (const Exclusion& hold : std::exchange(holds_, {})) {
    const Status held = store.Exclude(night_.area, hold);
    if (!held.ok() && held.code() != StatusCode::kAlreadyExists) return held;
  }
  return OkStatus();
}

// Whether any run was held. They are no more among those given.
StatusOr<bool> Area::HoldSuspects(const Judgement& judgement, std::vector<LogHead>* given) {
  if (judgement.suspects.empty()) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since,
                            ReadSincePublished(night_.area, options_.build.store, context_));
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

// Whether the map without some of the runs is not worse. It is published then, and these runs are
// held.
StatusOr<bool> Area::BuildWithout(const std::function<bool(const LogHead&)>& blames,
                                  const Judgement& judgement,
                                  const std::vector<LogHead>& given) {
  std::vector<LogHead> without = given;
  std::vector<LogHead> blamed;
  std::erase_if(without, [&](const LogHead& log) {
    if (!blames(log)) return false;
    blamed.push_back(log);
    return true;
  });
  if (without.empty() || blamed.empty()) return false;
  bool for_good = false;
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Candidate> candidate,
                            candidates_.Make(without, &night_.reasons, &waiting_, &for_good));
  if (!candidate) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(Judgement again, JudgeCandidate(*candidate, without));
  if (!again.worse.empty() || !again.suspects.empty()) return false;
  for (const LogHead& log : blamed) {
    SHIFTMAP_RETURN_IF_ERROR(
        Hold(log, "the map with it is worse for others: " + judgement.worse.front()));
  }
  night_.judgement = std::move(again);
  SHIFTMAP_RETURN_IF_ERROR(Publish(&*candidate));
  return true;
}

// Of a map that is worse the vehicle may be to blame whose runs fit the old map worst, or else the
// runs that made it worse in earlier nights.
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
  SHIFTMAP_ASSIGN_OR_RETURN(
      const bool done,
      BuildWithout(
          [&](const LogHead& log) { return log.info.vehicle == worst; }, judgement, given));
  if (done || !HasStore(options_)) return done;
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const RefusedVersions refused, ReadRefused(night_.area, &store));
  return BuildWithout(
      [&](const LogHead& log) { return log.begin <= refused.until; }, judgement, given);
}

void Area::Say(const std::string& line) {
  const std::vector<std::string>& said = night_.reasons;
  if (std::find(said.begin(), said.end(), line) == said.end()) night_.reasons.push_back(line);
}

// Removes the runs that a build left out from those that are given, so that it is judged without
// them. Returns whether there were any: then the map is built again.
StatusOr<bool> Area::LeaveOut(const Candidate& candidate) {
  std::vector<LogHead> out;
  std::vector<std::string> paths;
  for (const LogHead& log : given_) paths.push_back(log.path);
  const RunNames names(paths);
  std::erase_if(given_, [&](const LogHead& log) {
    if (candidate.version.Has(log)) return false;
    out.push_back(log);
    left_out_.insert(log.identity());
    return true;
  });
  for (const std::string& line : candidate.outcome.left_out) {
    const auto log = std::find_if(out.begin(), out.end(), [&](const LogHead& of) {
      return line.starts_with(fmt::format("run '{}' ", names.Of(of.path)));
    });
    if (log == out.end()) {
      Say(line);
      continue;
    }
    Say(fmt::format("{}; to ignore it: shiftmap-inspect runs exclude {}",
                    line,
                    HashFile(log->path).value_or(log->identity())));
  }
  for (const std::string& line : candidate.outcome.waiting) Say(line);
  for (const std::string& line : candidate.outcome.at_two_places) Say(line);
  night_.runs_waiting = std::max(night_.runs_waiting, candidate.outcome.waiting.size());
  if (candidate.build) {
    const std::vector<UnplacedRun>& wait = candidate.build->commit_options.waiting;
    waiting_.insert(waiting_.end(), wait.begin(), wait.end());
  }
  return !out.empty();
}

// The only place where a version of the night is written.
// Errors: kAborted if another version was published since the build began.
Status Area::Commit(bool publish, Candidate* candidate) {
  AreaBuild& build = *candidate->build;
  build.commit_options.publish = publish;
  std::vector<UnplacedRun>& waiting = build.commit_options.waiting;
  for (const UnplacedRun& run : waiting_) {
    const bool known = std::any_of(
        waiting.begin(), waiting.end(), [&](const auto& of) { return of.sha256 == run.sha256; });
    if (!known) waiting.push_back(run);
  }
  AreaBuildOptions options = options_.build;
  options.area = night_.area;
  SHIFTMAP_RETURN_IF_ERROR(CommitArea(options, context_, &build));
  candidate->version.number = build.commit->version;
  return WriteHolds();
}

Status Area::Publish(Candidate* candidate) {
  if (candidate->build) {
    SHIFTMAP_RETURN_IF_ERROR(Commit(true, candidate));
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
    SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(night_.area));
    const Status status = store.Publish(night_.area, *candidate->version.number, published);
    if (!status.ok() && status.code() != StatusCode::kAlreadyExists) return status;
  }
  Take(*candidate);
  night_.published = true;
  return OkStatus();
}

// Kept, so that somebody can look at it and publish it all the same.
Status Area::Refuse(const std::vector<std::string>& reasons, Candidate* candidate) {
  if (candidate->build) SHIFTMAP_RETURN_IF_ERROR(Commit(false, candidate));
  Take(*candidate);
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  return store.AddNote(
      night_.area,
      NightNote::kRefused,
      fmt::format("{} {}", candidate->version.number->value(), fmt::join(reasons, "; ")));
}

void Area::Take(const Candidate& candidate) {
  const std::vector<RunRecord>& runs = candidate.version.provenance.runs;
  night_.runs_again =
      static_cast<std::size_t>(std::count_if(runs.begin(), runs.end(), [&](const RunRecord& run) {
        return std::any_of(logs_.again.begin(), logs_.again.end(), [&](const LogHead& log) {
          return log.IsOf(run);
        });
      }));
  night_.runs_new = runs.size() - night_.runs_again;
  night_.version = candidate.version.number;
  night_.content_hash = candidate.version.map.content_hash();
  if (night_.judgement) night_.judgement->after = night_.version;
}

// Of builds that left no version.
Status Area::NoteWaiting() {
  const bool nothing = night_.version || waiting_.empty();
  if (nothing || !HasStore(options_) || context_.dry_run()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  const Status noted = store.NoteWaiting(night_.area, waiting_);
  return noted.code() == StatusCode::kNotFound ? OkStatus() : noted;
}

// Once something is published, what a build goes on from is another.
Status Area::NoteLeftOut() {
  const bool nothing = !logs_.fresh.empty() || night_.published || left_out_ == left_earlier_;
  if (nothing || !HasStore(options_) || context_.dry_run()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadWrite));
  return ::shiftmap::NoteLeftOut(options_, night_.area, asked_, left_out_, &store);
}

// Builds what is given once, and judges it.
StatusOr<Area::Step> Area::Build() {
  bool for_good = false;
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<Candidate> candidate,
                            candidates_.Make(given_, &night_.reasons, &waiting_, &for_good));
  if (!candidate) {
    for (const LogHead& log : given_) {
      if (for_good) left_out_.insert(log.identity());
    }
    return Step::kDone;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool less, LeaveOut(*candidate));
  if (less) return Step::kAgain;
  SHIFTMAP_RETURN_IF_ERROR(CheckUpToDate(*candidate));
  std::vector<std::string> objections;
  if (options_.no_judge) {
    SHIFTMAP_ASSIGN_OR_RETURN(objections, Objections(*candidate));
    if (objections.empty()) {
      SHIFTMAP_RETURN_IF_ERROR(Publish(&*candidate));
      return Step::kDone;
    }
  }
  if (candidate->version.number) {
    SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since,
                              ReadSincePublished(night_.area, options_.build.store, context_));
    if (since.refused.contains(*candidate->version.number)) {
      Take(*candidate);
      return Step::kDone;
    }
  }
  if (options_.no_judge) {
    SHIFTMAP_RETURN_IF_ERROR(Refuse(objections, &*candidate));
    return Step::kDone;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(Judgement judgement, JudgeCandidate(*candidate, given_));
  SHIFTMAP_ASSIGN_OR_RETURN(const bool held, HoldSuspects(judgement, &given_));
  if (held) return Step::kAgain;
  for (const std::string& doubt : judgement.doubts) Say(doubt);
  night_.judgement = judgement;
  if (judgement.worse.empty()) {
    SHIFTMAP_RETURN_IF_ERROR(Publish(&*candidate));
    return Step::kDone;
  }
  bool done = false;
  if (judgement.before) {
    SHIFTMAP_ASSIGN_OR_RETURN(done, BuildWithoutWorst(judgement, given_));
  }
  if (!done) SHIFTMAP_RETURN_IF_ERROR(Refuse(judgement.worse, &*candidate));
  return Step::kDone;
}

// What somebody excluded or held since the night looked for its logs.
Status Area::DropExcluded() {
  if (!HasStore(options_)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(MapStore::Access::kReadOnly));
  const StatusOr<std::vector<Exclusion>> exclusions = store.Exclusions(night_.area);
  if (exclusions.status().code() == StatusCode::kNotFound) return OkStatus();
  if (!exclusions.ok()) return exclusions.status();
  std::erase_if(given_, [&](const LogHead& log) {
    return FindExclusion(*exclusions, log.identity(), log.sha256, log.info.vehicle, log.begin) !=
           nullptr;
  });
  return OkStatus();
}

StatusOr<AreaNight> Area::Run() {
  SHIFTMAP_RETURN_IF_ERROR(HoldOut());
  for (int build = 1; build <= kMaxBuilds && !given_.empty(); ++build) {
    const StatusOr<Step> step = Build();
    // Somebody published another version meanwhile, or decided about a run, or a log grew.
    if (step.status().code() == StatusCode::kAborted && build < kMaxBuilds) {
      SHIFTMAP_RETURN_IF_ERROR(DropExcluded());
      continue;
    }
    if (!step.ok()) return step.status();
    if (*step == Step::kDone) break;
  }
  SHIFTMAP_RETURN_IF_ERROR(NoteWaiting());
  SHIFTMAP_RETURN_IF_ERROR(NoteLeftOut());
  if (HasStore(options_) && !context_.dry_run()) {
    SHIFTMAP_RETURN_IF_ERROR(CompactRefused(night_.area, options_.build.store, context_));
  }
  return night_;
}

}  // namespace

StatusOr<AreaNight> RunAreaNight(const NightOptions& options,
                                 const std::string& area,
                                 const AreaLogs& logs,
                                 Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(AreaNight night, Area(options, area, logs, &context).Run());
  SHIFTMAP_ASSIGN_OR_RETURN(const SincePublished since,
                            ReadSincePublished(area, options.build.store, context));
  night.refused_in_a_row = static_cast<int>(since.refused.size());
  if (night.version && !night.published) {
    const auto refused = since.refused.find(*night.version);
    if (refused != since.refused.end()) {
      SHIFTMAP_ASSIGN_OR_RETURN(
          MapStore store, OpenStore(options.build.store, MapStore::Access::kReadOnly, context));
      SHIFTMAP_ASSIGN_OR_RETURN(const std::string command,
                                PublishCommand(area, *night.version, &store));
      night.reasons.insert(night.reasons.begin(),
                           fmt::format("version {} is not published: {}; to take it all the same: "
                                       "{}",
                                       refused->first.value(),
                                       refused->second,
                                       command));
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
