// SPDX-License-Identifier: Apache-2.0
//
// The night of a fleet: what its vehicles brought back goes into the maps.
#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/cli/build_report.h"
#include "mapper/cli/commands.h"
#include "mapper/cli/fleet_folder.h"
#include "mapper/cli/stop_signals.h"
#include "mapstore/cli/exit_codes.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/owned_fd.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

constexpr std::size_t kSha256Digits = 64;

struct NightlyOptions {
  std::string logs;
  std::optional<std::string> area;
  double min_age_s = 60.0;
  AreaBuildOptions build;  // Of each area; `area` and `logs` are set there.
};

// One night at a time on a store. The lock ends with the process.
StatusOr<OwnedFd> LockNight(const std::string& store) {
  constexpr mode_t kFileAccess = 0640;
  const std::string path = store + ".nightly";
  OwnedFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kFileAccess));
  if (fd.get() < 0) return Unavailable("lock '{}': cannot be written", path);
  if (flock(fd.get(), LOCK_EX | LOCK_NB) == 0) return fd;
  return Unavailable("map store '{}': another night is under way", store);
}

// Whether a file was written so lately that it may not be whole. One that comes from a clock that
// was far ahead is old.
bool IsFresh(const std::string& path, double min_age_s) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return false;
  const Stamp written = Stamp(std::chrono::seconds(status.st_mtim.tv_sec) +
                              std::chrono::nanoseconds(status.st_mtim.tv_nsec));
  const Stamp now = SystemNow();
  const Duration min_age = FromSeconds(min_age_s);
  return now < written + min_age && written < now + min_age;
}

// What the night did, and what it left for a person to see.
class Night {
 public:
  Night(const NightlyOptions& options, Context* context) : options_(options), context_(*context) {}

  Status Run();

 private:
  struct AreaLogs {
    std::vector<LogHead> fresh;     // No build has seen them.
    std::vector<LogHead> waiting;   // An earlier build could not place them.
    std::vector<LogHead> again;     // In the map, but not in what a build goes on from.
    std::vector<std::string> held;  // Lines about logs that somebody has to decide about.
  };

  Status ReturnReports();
  Status FindLogs();
  StatusOr<std::optional<std::string>> OnlyArea(MapStore* store);
  Status Sort(const std::string& area, std::vector<LogHead> logs, MapStore* store);
  Status Build(const std::string& area, const AreaLogs& logs);
  Status BuildNew(const std::string& area,
                  const AreaLogs& logs,
                  Json* document,
                  std::vector<std::string>* reasons);
  Status NameDistrusted(const std::string& area, std::vector<std::string>* reasons);
  bool HasStore() const {
    std::error_code error;
    return std::filesystem::exists(options_.build.store, error);
  }
  void Leave(const std::string& text) {
    context_.Attend(text);
    left_.push_back(text);
  }
  void Report();

  const NightlyOptions& options_;
  Context& context_;
  std::map<std::string, AreaLogs> areas_;
  int reports_new_ = 0;
  int reports_known_ = 0;
  std::vector<std::string> left_;  // Of no area.
  Json area_documents_ = Json::array();
  std::string text_;
  int versions_ = 0;
};

// A report that is refused is named every night, and keeps none of the others.
Status Night::ReturnReports() {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> paths,
                            FindFiles(options_.logs, ".report"));
  // Without a store they are about nothing.
  if (paths.empty() || !HasStore() || context_.dry_run()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options_.build.store,
                                      MapStore::Access::kReadWrite,
                                      context_,
                                      options_.build.clock_tolerance_s));
  for (const std::string& path : paths) {
    const StatusOr<ShiftReport> report = ReadShiftReport(path);
    Status status = report.status();
    if (status.ok()) {
      const StatusOr<ReturnResult> result = store.Return(*report);
      status = result.status();
      if (status.code() == StatusCode::kUnavailable) return status;
      if (status.ok()) ++(result->duplicate ? reports_known_ : reports_new_);
    }
    if (!status.ok()) Leave(fmt::format("report '{}' is left out: {}", path, Message(status)));
  }
  return OkStatus();
}

// The area of logs that name none: the one that was given, or the only one there is.
// @param store  Null if there is none.
StatusOr<std::optional<std::string>> Night::OnlyArea(MapStore* store) {
  if (options_.area || store == nullptr) return options_.area;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store->Areas());
  if (areas.size() != 1) return std::optional<std::string>();
  return std::optional(areas.front().area);
}

Status Night::FindLogs() {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> paths,
                            FindFiles(options_.logs, ".mcap"));
  std::optional<MapStore> opened;
  if (HasStore()) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        opened, OpenStore(options_.build.store, MapStore::Access::kReadOnly, context_));
  }
  MapStore* const store = opened ? &*opened : nullptr;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> only, OnlyArea(store));
  std::map<std::string, std::vector<LogHead>> logs;
  for (const std::string& path : paths) {
    if (IsFresh(path, options_.min_age_s)) {
      Leave(fmt::format("run log '{}' was written in the last {} s, and is left for another night",
                        path,
                        options_.min_age_s));
      continue;
    }
    StatusOr<LogHead> head = ReadLogHead(path);
    if (!head.ok()) {
      Leave(Message(head.status()));
      continue;
    }
    const std::string area = head->info.area.empty() ? only.value_or("") : head->info.area;
    if (area.empty()) {
      Leave(fmt::format("run log '{}' names no area: --area says which", path));
      continue;
    }
    if (!options_.area || area == *options_.area) logs[area].push_back(*std::move(head));
  }
  for (auto& [area, of_area] : logs) {
    SHIFTMAP_RETURN_IF_ERROR(Sort(area, std::move(of_area), store));
  }
  return OkStatus();
}

// Which of an area's logs are not in its map.
// @param store  Null if there is none.
Status Night::Sort(const std::string& area, std::vector<LogHead> logs, MapStore* store) {
  std::set<std::string> mapped;
  std::set<std::string> kept;     // Of these, what is in the version that a build goes on from.
  std::set<std::string> waiting;  // Hashes.
  std::vector<Exclusion> exclusions;
  if (store != nullptr) {
    const StatusOr<std::optional<VersionNumber>> published = store->PublishedVersion(area);
    if (published.ok()) {
      SHIFTMAP_ASSIGN_OR_RETURN(exclusions, store->Exclusions(area));
      SHIFTMAP_ASSIGN_OR_RETURN(const auto runs, store->WaitingRuns(area));
      for (const UnplacedRun& run : runs) waiting.insert(run.sha256);
      if (*published) {
        SHIFTMAP_ASSIGN_OR_RETURN(mapped, store->RunIdentities(area, **published));
        // The build says what is wrong with it.
        const StatusOr<VersionNumber> prior = FindPriorVersion(area, **published, store, nullptr);
        SHIFTMAP_ASSIGN_OR_RETURN(kept,
                                  store->RunIdentities(area, prior.ok() ? *prior : **published));
      }
    } else if (published.status().code() != StatusCode::kNotFound) {
      return published.status();
    }
  }
  // A log that has a UUID may be known by its hash, which takes a reading of the whole file.
  const bool by_hash =
      !waiting.empty() || std::any_of(exclusions.begin(), exclusions.end(), [](const auto& of) {
        return of.run.size() == kSha256Digits;
      });
  AreaLogs& sorted = areas_[area];
  const auto is_out = [&](const std::string& run, const LogHead& log) {
    const Exclusion* const exclusion = FindExclusion(exclusions, run, log.info.vehicle, log.begin);
    if (exclusion == nullptr) return false;
    if (exclusion->held) {
      sorted.held.push_back(fmt::format("'{}' is held: {}", log.path, exclusion->reason));
    }
    return true;
  };
  for (LogHead& log : logs) {
    if (is_out(log.identity(), log) || kept.contains(log.identity())) continue;
    if (by_hash && log.sha256.empty()) {
      SHIFTMAP_ASSIGN_OR_RETURN(log.sha256, HashFile(log.path));
    }
    if (by_hash && is_out(log.sha256, log)) continue;
    const bool again = mapped.contains(log.identity());
    std::vector<LogHead>& kind = again                          ? sorted.again
                                 : waiting.contains(log.sha256) ? sorted.waiting
                                                                : sorted.fresh;
    kind.push_back(std::move(log));
  }
  return OkStatus();
}

// Builds the new runs of an area, with those that wait. An area whose build fails is named.
Status Night::BuildNew(const std::string& area,
                       const AreaLogs& logs,
                       Json* document,
                       std::vector<std::string>* reasons) {
  AreaBuildOptions build = options_.build;
  build.area = area;
  for (const std::vector<LogHead>* const kind : {&logs.fresh, &logs.waiting, &logs.again}) {
    for (const LogHead& log : *kind) build.logs.push_back(log.path);
  }
  const StatusOr<AreaBuild> built = BuildArea(build, context_);
  if (built.status().code() == StatusCode::kCancelled) return built.status();
  if (!built.ok()) {
    reasons->push_back(Message(built.status()));
    text_ += fmt::format("{}: no version\n", InertLine(area));
    return OkStatus();
  }
  // Why runs of the build are not in the map.
  *reasons = LeftOutLines(built->result);
  const std::vector<std::string> waiting = WaitingLines(built->result);
  reasons->insert(reasons->end(), waiting.begin(), waiting.end());
  if (!built->commit) {
    text_ += fmt::format("{}: {} runs, no version\n", InertLine(area), build.logs.size());
    return OkStatus();
  }
  const auto version = built->commit->version.value();
  (*document)["version"] = version;
  (*document)["published"] = true;
  ++versions_;
  text_ += fmt::format(
      "{}: version {} with {} runs more\n", InertLine(area), version, built->result.runs.size());
  return OkStatus();
}

// Somebody has to look at a vehicle that contradicts the others.
Status Night::NameDistrusted(const std::string& area, std::vector<std::string>* reasons) {
  if (!HasStore()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options_.build.store, MapStore::Access::kReadOnly, context_));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(area));
  if (!published) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VehicleTrust> trust, store.Trust(area));
  for (const VehicleTrust& vehicle : trust) {
    if (!IsDistrusted(vehicle)) continue;
    reasons->push_back(fmt::format("vehicle '{}' contradicts the others and is not believed",
                                   InertLine(vehicle.vehicle)));
  }
  return OkStatus();
}

Status Night::Build(const std::string& area, const AreaLogs& logs) {
  Json document = {{"area", area},
                   {"runs_new", logs.fresh.size()},
                   {"version", nullptr},
                   {"published", false},
                   {"reasons", Json::array()}};
  std::vector<std::string> reasons;
  if (logs.fresh.empty()) {
    for (const LogHead& log : logs.waiting) reasons.push_back(fmt::format("'{}' waits", log.path));
    text_ += fmt::format("{}: nothing new\n", InertLine(area));
  } else {
    SHIFTMAP_RETURN_IF_ERROR(BuildNew(area, logs, &document, &reasons));
  }
  reasons.insert(reasons.end(), logs.held.begin(), logs.held.end());
  SHIFTMAP_RETURN_IF_ERROR(NameDistrusted(area, &reasons));
  for (const std::string& reason : reasons) {
    document["reasons"].push_back(reason);
    context_.Attend(fmt::format("area '{}': {}", area, reason));
  }
  area_documents_.push_back(std::move(document));
  return OkStatus();
}

void Night::Report() {
  context_.Report({{"areas", area_documents_},
                   {"reports", {{"new", reports_new_}, {"known", reports_known_}}},
                   {"left", left_}},
                  fmt::format("{} new reports\n{}", reports_new_, text_));
}

Status Night::Run() {
  SHIFTMAP_RETURN_IF_ERROR(ReturnReports());
  SHIFTMAP_RETURN_IF_ERROR(FindLogs());
  for (const auto& [area, logs] : areas_) SHIFTMAP_RETURN_IF_ERROR(Build(area, logs));
  Report();
  if (versions_ > 0 || reports_new_ > 0 || context_.done_code() != ExitCode::kDone ||
      context_.dry_run()) {
    return OkStatus();
  }
  return MakeStatus(StatusCode::kAlreadyExists,
                    "map store '{}': nothing new in '{}'",
                    options_.build.store,
                    options_.logs);
}

Status Nightly(const NightlyOptions& options, Context& context) {
  const StopSignals signals;
  if (context.dry_run()) return Night(options, &context).Run();
  SHIFTMAP_RETURN_IF_ERROR(MapStore::CheckWritable(options.build.store));
  SHIFTMAP_ASSIGN_OR_RETURN(const OwnedFd lock, LockNight(options.build.store));
  return Night(options, &context).Run();
}

}  // namespace

void AddNightlyCommand(Application* application) {
  auto options = std::make_shared<NightlyOptions>();
  Command& command =
      application->AddCommand("nightly",
                              "Return the reports and map the runs that a fleet left in a folder",
                              [options](Context& context) { return Nightly(*options, context); });
  AddLimitOptions(&options->build.limits, &command);
  AddClockToleranceOption(&options->build.clock_tolerance_s, &command);
  command.Option("--store", &options->build.store, "Map store; made if there is none")
      .Required()
      .Option(
          "--logs", &options->logs, "Folder with run logs and shift reports, and its subfolders")
      .Required()
      .Option("--area",
              &options->area,
              "Only this area, which is that of logs that name none; by default all, and such logs "
              "are of the only one there is")
      .Option("--min-age-s",
              &options->min_age_s,
              "Leave a log that was written since for another night: it may not be whole")
      .InRange(0.0, 1e9)
      .Flag("--no-learned-rates",
            &options->build.no_learned_rates,
            "Leave the rates of known landmarks' mode chains as they are")
      .Option("--threads",
              &options->build.threads,
              "Threads of a build, by default as many as the machine runs; the map is the same")
      .InRange(1, 256)
      .Option("--max-memory-mib",
              &options->build.max_memory_mib,
              "Leave out the largest logs of a build that would take more; by default, than this "
              "process can have")
      .InRange(1.0, 1e9)
      .Writes();
}

}  // namespace shiftmap
