// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/night.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <map>
#include <optional>
#include <set>
#include <utility>

#include "mapper/nightly/log_area.h"
#include "mapper/nightly/log_limits.h"
#include "mapstore/cli/stop_signals.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {
namespace {

StatusOr<MapStore> Open(const NightOptions& options,
                        MapStore::Access access,
                        const Context& context) {
  return OpenStore(options.build.store, access, context, options.build.clock_tolerance_s);
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

// Whether somebody excluded a file that is of no area, by its hash.
StatusOr<bool> IsIgnored(const std::string& run, MapStore& store) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  for (const AreaSummary& area : areas) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<Exclusion> exclusions, store.Exclusions(area.area));
    for (const Exclusion& exclusion : exclusions) {
      if (exclusion.run == run && !exclusion.held) return true;
    }
  }
  return false;
}

// A report that is refused is named every night until somebody excludes it by its hash, and keeps
// none of the others.
Status ReturnReports(const NightOptions& options, const Context& context, NightWork* work) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> paths,
                            FindFiles(options.logs, ".report"));
  // Without a store they are about nothing.
  if (paths.empty() || !HasStore(options) || context.dry_run()) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(options, MapStore::Access::kReadWrite, context));
  for (const std::string& path : paths) {
    const StatusOr<ShiftReport> report = ReadShiftReport(path);
    Status status = report.status();
    if (status.ok()) status = CheckClockWasSet("shift report " + report->uuid, report->begin);
    if (status.ok()) {
      const StatusOr<ReturnResult> result = store.Return(*report);
      status = result.status();
      if (status.code() == StatusCode::kUnavailable) return status;
      if (status.ok()) ++(result->duplicate ? work->reports_known : work->reports_new);
    }
    if (status.ok()) continue;
    std::string text = fmt::format("report '{}' is left out: {}; delete it", path, Message(status));
    if (const StatusOr<std::string> hash = HashFile(path); hash.ok()) {
      SHIFTMAP_ASSIGN_OR_RETURN(const bool ignored, IsIgnored(*hash, store));
      if (ignored) continue;
      text += fmt::format(", or: shiftmap-inspect runs exclude {}", *hash);
    }
    work->left.push_back(std::move(text));
  }
  return OkStatus();
}

// Finds the area of each log of a folder.
class LogSorter {
 public:
  // @param store  Null if there is none.
  LogSorter(const NightOptions& options, const Context& context, MapStore* store, NightWork* work)
      : options_(options), context_(context), store_(store), work_(*work) {}

  Status Start();
  Status Take(const std::string& path);
  const std::map<std::string, std::vector<LogHead>>& logs() const { return logs_; }

 private:
  StatusOr<std::optional<std::string>> AreaOf(const LogHead& log);
  // Whether it is left out for good, and is noted as such.
  StatusOr<bool> Ignore(const std::string& path, const std::string& run);
  void Leave(std::string text) { work_.left.push_back(std::move(text)); }

  const NightOptions& options_;
  const Context& context_;
  MapStore* store_;
  NightWork& work_;
  std::optional<std::string> only_;  // The area of logs that name none.
  int published_ = 0;
  std::optional<std::vector<AuditEntry>> audit_;
  std::map<std::string, std::vector<LogHead>> logs_;
};

Status LogSorter::Start() {
  only_ = options_.area;
  if (store_ == nullptr) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store_->Areas());
  published_ = static_cast<int>(
      std::count_if(areas.begin(), areas.end(), [](const auto& area) { return area.published; }));
  if (!only_ && areas.size() == 1) only_ = areas.front().area;
  return OkStatus();
}

StatusOr<bool> LogSorter::Ignore(const std::string& path, const std::string& run) {
  if (store_ == nullptr) return false;
  SHIFTMAP_ASSIGN_OR_RETURN(const bool ignored, IsIgnored(run, *store_));
  if (ignored) work_.ignored.push_back(path);
  return ignored;
}

// The area of a log that names none; nothing if it is left out.
StatusOr<std::optional<std::string>> LogSorter::AreaOf(const LogHead& log) {
  if (only_) return only_;
  const std::string who = fmt::format("run log '{}' names no area", log.path);
  if (published_ == 0) {
    Leave(who + ": --area says which");
    return std::optional<std::string>();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool ignored, Ignore(log.path, log.identity()));
  if (ignored) return std::optional<std::string>();
  if (!audit_) {
    SHIFTMAP_ASSIGN_OR_RETURN(audit_, store_->AuditLog(std::nullopt, {AuditAction::kLocate}));
  }
  std::optional<LogAreas> areas = KnownAreas(log.identity(), published_, *audit_);
  if (!areas) {
    const StatusOr<LogAreas> located = LocateLog(log, store_, [] {
      return StopSignals::Received().empty()
                 ? OkStatus()
                 : MakeStatus(StatusCode::kCancelled, "night stopped by a signal");
    });
    if (located.status().code() == StatusCode::kInvalidArgument ||
        located.status().code() == StatusCode::kDataLoss) {
      Leave(Message(located.status()));
      return std::optional<std::string>();
    }
    if (!located.ok()) return located.status();
    areas = *located;
    if (!context_.dry_run()) {
      SHIFTMAP_ASSIGN_OR_RETURN(MapStore writer,
                                Open(options_, MapStore::Access::kReadWrite, context_));
      SHIFTMAP_RETURN_IF_ERROR(writer.AddNote(
          std::nullopt, NightNote::kLocated, LocatedSubject(log.identity(), *areas)));
    }
  }
  if (areas->fit.size() == 1) return std::optional(areas->fit.front());
  Leave(
      fmt::format("{}, and fits {} of the {} maps; --area says which, and shiftmap-inspect runs "
                  "exclude {} leaves it out for good",
                  who,
                  areas->fit.empty() ? "none" : "several",
                  areas->asked,
                  log.identity()));
  return std::optional<std::string>();
}

Status LogSorter::Take(const std::string& path) {
  if (IsFresh(path, options_.min_age_s)) {
    Leave(fmt::format("run log '{}' was written in the last {} s, and is left for another night",
                      path,
                      options_.min_age_s));
    return OkStatus();
  }
  StatusOr<LogHead> head = ReadLogHead(path);
  if (!head.ok()) {
    const StatusOr<std::string> hash = HashFile(path);
    bool ignored = false;
    if (hash.ok()) {
      SHIFTMAP_ASSIGN_OR_RETURN(ignored, Ignore(path, *hash));
    }
    if (ignored) return OkStatus();
    std::string text = Message(head.status());
    if (hash.ok()) {
      text += fmt::format("; delete it, or: shiftmap-inspect runs exclude {}", *hash);
    }
    Leave(std::move(text));
    return OkStatus();
  }
  std::string area = head->info.area;
  if (area.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> found, AreaOf(*head));
    if (!found) return OkStatus();
    area = *found;
  }
  if (!options_.area || area == *options_.area) logs_[area].push_back(*std::move(head));
  return OkStatus();
}

Status FindLogs(const NightOptions& options, const Context& context, NightWork* work) {
  std::vector<std::string> unreadable;
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> paths,
                            FindFiles(options.logs, ".mcap", &unreadable));
  for (const std::string& folder : unreadable) {
    work->left.push_back(fmt::format("folder '{}' is left out: it cannot be read", folder));
  }
  std::optional<MapStore> opened;
  if (HasStore(options)) {
    SHIFTMAP_ASSIGN_OR_RETURN(opened, Open(options, MapStore::Access::kReadOnly, context));
  }
  MapStore* const store = opened ? &*opened : nullptr;
  LogSorter sorter(options, context, store, work);
  SHIFTMAP_RETURN_IF_ERROR(sorter.Start());
  for (const std::string& path : paths) SHIFTMAP_RETURN_IF_ERROR(sorter.Take(path));
  for (const auto& [area, logs] : sorter.logs()) {
    SHIFTMAP_ASSIGN_OR_RETURN(work->areas[area], SortLogs(area, logs, store));
  }
  if (store == nullptr) return OkStatus();
  // Of areas without a log.
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store->Areas());
  for (const AreaSummary& area : areas) {
    const bool other = options.area && area.area != *options.area;
    if (other || work->areas.contains(area.area)) continue;
    SHIFTMAP_ASSIGN_OR_RETURN(AreaLogs sorted, SortLogs(area.area, {}, store));
    if (!sorted.held.empty()) work->areas[area.area] = std::move(sorted);
  }
  return OkStatus();
}

// Leaves out files of the same content as another one: they are one run, and judge once.
AreaLogs WithoutCopies(AreaLogs logs) {
  const auto kinds = {&logs.fresh, &logs.waiting, &logs.again, &logs.mapped};
  std::map<std::string, int> files;
  for (const std::vector<LogHead>* const kind : kinds) {
    for (const LogHead& log : *kind) ++files[log.identity()];
  }
  std::set<std::string> seen;
  for (std::vector<LogHead>* const kind : kinds) {
    std::erase_if(*kind, [&](const LogHead& log) {
      if (files[log.identity()] == 1) return false;
      const StatusOr<std::string> hash = HashFile(log.path);  // A head need not have it.
      return hash.ok() && !seen.insert(*hash).second;
    });
  }
  return logs;
}

// Leaves out what a clock that was never set recorded: its visits would count as the oldest.
AreaLogs WithoutUnsetClocks(AreaLogs logs, std::vector<std::string>* reasons) {
  for (std::vector<LogHead>* const kind : {&logs.fresh, &logs.waiting, &logs.again}) {
    std::erase_if(*kind, [&](const LogHead& log) {
      if (log.begin >= kFirstPlausibleStamp) return false;
      reasons->push_back(
          fmt::format("'{}' is left out: it begins at {} UTC, as if the vehicle's clock was not "
                      "set; to ignore it: shiftmap-inspect runs exclude {}",
                      log.path,
                      FormatUtc(log.begin),
                      HashFile(log.path).value_or(log.identity())));
      return true;
    });
  }
  return logs;
}

// Somebody has to look at a vehicle that contradicts the others.
Status NameDistrusted(const NightOptions& options, const Context& context, AreaNight* night) {
  if (!HasStore(options)) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(options, MapStore::Access::kReadOnly, context));
  SHIFTMAP_ASSIGN_OR_RETURN(const auto published, store.PublishedVersion(night->area));
  if (!published) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<VehicleTrust> trust, store.Trust(night->area));
  for (const VehicleTrust& vehicle : trust) {
    if (!IsDistrusted(vehicle)) continue;
    night->reasons.push_back(fmt::format("vehicle '{}' contradicts the others and is not believed",
                                         InertLine(vehicle.vehicle)));
  }
  return OkStatus();
}

}  // namespace

int NightResult::versions() const {
  return static_cast<int>(
      std::count_if(areas.begin(), areas.end(), [](const auto& area) { return area.published; }));
}

StatusOr<std::vector<std::string>> BeginNight(const NightOptions& options,
                                              Stamp begin,
                                              Context& context,
                                              NightLock* lock) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<Stamp> interrupted, lock->Begin(begin));
  if (!interrupted || !HasStore(options)) return std::vector<std::string>();
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, Open(options, MapStore::Access::kReadOnly, context));
  return NameUnreported(store, *interrupted, begin);
}

StatusOr<NightWork> FindWork(const NightOptions& options, Context& context) {
  NightWork work;
  SHIFTMAP_RETURN_IF_ERROR(ReturnReports(options, context, &work));
  SHIFTMAP_RETURN_IF_ERROR(FindLogs(options, context, &work));
  return work;
}

StatusOr<AreaNight> RunArea(const NightOptions& options,
                            const std::string& area,
                            const AreaLogs& files,
                            Context& context) {
  context.SayEachOnce();  // Of logs that it builds from several times.
  const AreaLogs all = WithoutCopies(files);
  std::vector<std::string> unset;
  const AreaLogs logs = WithoutUnsetClocks(all, &unset);
  AreaNight night;
  night.area = area;
  if (logs.fresh.empty() && logs.again.empty()) {
    for (const LogHead& log : logs.waiting) {
      night.reasons.push_back(fmt::format("'{}' waits", log.path));
    }
  } else {
    SHIFTMAP_ASSIGN_OR_RETURN(night, RunAreaNight(options, area, logs, context));
  }
  if (!night.version) {
    night.runs_new = all.fresh.size();
    night.runs_again = all.again.size();
  }
  night.reasons.insert(night.reasons.end(), unset.begin(), unset.end());
  night.reasons.insert(night.reasons.end(), logs.held.begin(), logs.held.end());
  SHIFTMAP_RETURN_IF_ERROR(NameDistrusted(options, context, &night));
  return night;
}

StatusOr<NightResult> RunNight(const NightOptions& options, Context& context) {
  NightResult result;
  SHIFTMAP_ASSIGN_OR_RETURN(result.work, FindWork(options, context));
  for (const auto& [area, logs] : result.work.areas) {
    SHIFTMAP_ASSIGN_OR_RETURN(AreaNight night, RunArea(options, area, logs, context));
    result.areas.push_back(std::move(night));
  }
  SHIFTMAP_ASSIGN_OR_RETURN((context.dry_run() ? result.logs_to_delete : result.logs_deleted),
                            KeepLogLimits(options, context, &result.work));
  return result;
}

}  // namespace shiftmap
