// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/run_loader.h"

#include <fmt/format.h>

#include <algorithm>
#include <optional>
#include <set>
#include <tuple>
#include <utility>

#include "mapper/cli/run_copies.h"
#include "mapper/memory_estimate.h"
#include "mapstore/cli/exit_codes.h"
#include "mapstore/codec/run_log.h"

namespace shiftmap {
namespace {

// What of the bound one log may take while it is read. Those that were read take as much at most: a
// build needs them twice (memory_estimate.cc).
constexpr std::int64_t kReaderShare = 2;

std::string LogName(const std::string& path) { return fmt::format("run log '{}'", path); }

class Loader {
 public:
  Loader(const RunLoaderOptions& options, const Context& context)
      : options_(options),
        context_(context),
        // Trajectories are files of a run's name, in one folder.
        names_(options.unique_names ? std::vector<std::string>() : options.logs),
        choice_(options.max_memory_bytes, options.prior_modes, options.threads) {}

  Status Load(const std::string& path);
  StatusOr<LoadedRuns> Finish();

 private:
  struct Loaded {
    std::string path;
    MapperInput input;
  };

  void Reject(const std::string& path, const Status& status, bool longer = false) {
    rejected_.push_back({names_.Of(path), status, longer});
  }
  // Drops what no vehicle or sensor does.
  Status DropImplausibleItems(const std::string& path, RunLog* log);
  Status CheckName(const std::string& path, const std::string& name);
  StatusOr<const LineRun*> MappedRunOf(const RunLog& log) const;
  StatusOr<bool> IsMapped(const std::string& path, const RunLog& log);
  bool KeepLongest(const std::string& path, const RunLog& log);

  struct Rejection {
    std::string name;
    Status status;
    bool longer;  // Than the log of the run that is in the map.
  };

  const RunLoaderOptions& options_;
  const Context& context_;
  const RunNames names_;
  std::set<std::string> seen_;                // Hashes.
  std::map<std::string, std::string> paths_;  // By name.
  RunChoice choice_;
  std::map<std::string, Loaded> loaded_;  // By hash.
  std::vector<Rejection> rejected_;
  std::map<std::string, ImplausibleItems> dropped_;
};

Status Loader::DropImplausibleItems(const std::string& path, RunLog* log) {
  const ImplausibleItems dropped = DropImplausible(options_.limits, &log->run);
  if (!dropped.any()) return OkStatus();
  if (log->run.odometry.empty()) {
    return InvalidArgument("{}: no odometry within the limits", LogName(path));
  }
  dropped_[log->sha256] = dropped;
  context_.Warn(
      fmt::format("{}: {} odometry samples and {} observations are beyond the limits and dropped",
                  LogName(path),
                  dropped.odometry,
                  dropped.observations));
  return OkStatus();
}

Status Loader::CheckName(const std::string& path, const std::string& name) {
  const auto [named, added] = paths_.try_emplace(name, path);
  if (added || !options_.unique_names) return OkStatus();
  return InvalidArgument(
      "run logs '{}' and '{}': their trajectories would be one file", named->second, path);
}

// The run of the map that a log is of, or null.
StatusOr<const LineRun*> Loader::MappedRunOf(const RunLog& log) const {
  const auto is_log_of = [&](const LineRun& like) -> StatusOr<bool> {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<EvidenceRow> rows, options_.known_visits());
    return IsLogOf(log.run, like.run, rows);
  };
  return FindMappedRun(options_.known_runs, log.run.info, log.sha256, BeginOf(log.run), is_log_of);
}

// What a run says counts once.
StatusOr<bool> Loader::IsMapped(const std::string& path, const RunLog& log) {
  SHIFTMAP_ASSIGN_OR_RETURN(const LineRun* const mapped, MappedRunOf(log));
  if (mapped == nullptr) return false;
  if (mapped->run.sha256 == log.sha256) {
    Reject(path, MakeStatus(StatusCode::kAlreadyExists, "already in the map"));
    return true;
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<std::string> rest,
                            options_.missing_rest(*mapped, log.run));
  Reject(path,
         rest ? MakeStatus(StatusCode::kAlreadyExists, "{}: {}", LogName(path), *rest)
              : MakeStatus(StatusCode::kAlreadyExists,
                           "another copy of the run is in the map already"),
         rest.has_value());
  return true;
}

// Of logs of one run the one that tells most of it: of copies it has the others in it.
bool Loader::KeepLongest(const std::string& path, const RunLog& log) {
  const auto copy = std::find_if(loaded_.begin(), loaded_.end(), [&](const auto& loaded) {
    return AreOfOneRun(loaded.second.input.run, log.run);
  });
  if (copy == loaded_.end()) return true;
  const Run& other = copy->second.input.run;
  const bool longer = HasFewer(other, log.run);
  const Run& kept = longer ? log.run : other;
  const Run& left = longer ? other : log.run;
  const bool apart = EndOf(left) < BeginOf(kept) || EndOf(kept) < BeginOf(left);
  const bool foreign = left.info.vehicle != kept.info.vehicle;
  const bool has_all = EndOf(left) <= EndOf(kept) && HasScansOf(kept, left);
  const std::string& left_path = longer ? copy->second.path : path;
  Reject(left_path,
         InvalidArgument("{}: {} {}",
                         LogName(left_path),
                         foreign   ? "has the run UUID, but not the vehicle, of"
                         : apart   ? "has the run UUID, but not the time, of"
                         : has_all ? "a copy of the run, not longer than"
                                   : "has other scans of the run, and not more observations than",
                         LogName(longer ? path : copy->second.path)));
  if (longer) {
    choice_.Remove(copy->first);
    loaded_.erase(copy);
  }
  return longer;
}

Status Loader::Load(const std::string& path) {
  StatusOr<RunLog> log = ReadRunLog(path,
                                    {.max_memory_bytes = options_.max_memory_bytes / kReaderShare,
                                     .lidar_scans = options_.lidar_scans});
  if (!log.ok()) {
    if (ExitCodeFor(log.status()) != ExitCode::kBadInput) return log.status();
    Reject(path, log.status());
    return OkStatus();
  }
  if (!log->truncation.empty()) {
    context_.Warn(fmt::format("{}: {}", LogName(path), log->truncation));
  }
  if (!seen_.insert(log->sha256).second) {
    Reject(path, MakeStatus(StatusCode::kAlreadyExists, "the log is given twice"));
    return OkStatus();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const bool mapped, IsMapped(path, *log));
  if (mapped) return OkStatus();
  const RunInfo& info = log->run.info;
  if (!info.area.empty() && info.area != options_.area) {
    Reject(path, InvalidArgument("{}: is of area '{}'", LogName(path), info.area));
    return OkStatus();
  }
  Status usable =
      CheckNotInFuture(LogName(path), EndOf(log->run), options_.now, options_.clock_tolerance_s);
  if (usable.ok()) usable = DropImplausibleItems(path, &*log);
  if (!usable.ok()) {
    Reject(path, usable);
    return OkStatus();
  }
  const Status set = CheckClockWasSet(LogName(path), BeginOf(log->run));
  if (!set.ok()) context_.Warn(Message(set) + ": its visits count as older than all others");
  const std::string name = names_.Of(path);
  SHIFTMAP_RETURN_IF_ERROR(CheckName(path, name));

  if (!KeepLongest(path, *log)) return OkStatus();
  BuildSize size;
  AddRun(log->run, &size);
  loaded_[log->sha256] = {path, {name, log->sha256, std::move(log->run)}};
  for (const RunChoice::LeftOut& out : choice_.Add(log->sha256, size)) {
    Reject(loaded_.at(out.id).path,
           InvalidArgument("{}: {}", LogName(loaded_.at(out.id).path), out.reason));
    loaded_.erase(out.id);
  }
  return OkStatus();
}

StatusOr<LoadedRuns> Loader::Finish() {
  std::sort(rejected_.begin(), rejected_.end(), [](const Rejection& a, const Rejection& b) {
    return std::forward_as_tuple(a.name, Message(a.status)) <
           std::forward_as_tuple(b.name, Message(b.status));
  });
  LoadedRuns runs;
  runs.dropped = std::move(dropped_);
  int unusable = 0;
  Status first;   // That is not in the map.
  Status longer;  // Or not whole.
  for (const Rejection& rejection : rejected_) {
    const bool known = rejection.status.code() == StatusCode::kAlreadyExists;
    runs.rejected.push_back({rejection.name, Message(rejection.status), known});
    if (!known) ++unusable;
    if (first.ok() && !known) first = rejection.status;
    if (longer.ok() && rejection.longer) longer = rejection.status;
  }
  for (auto& [hash, loaded] : loaded_) runs.inputs.push_back(std::move(loaded.input));
  if (!runs.inputs.empty()) return runs;
  if (unusable > 1) {
    return MakeStatus(first.code(), "no run can be used: {}", ReasonsOf(runs.rejected));
  }
  SHIFTMAP_RETURN_IF_ERROR(first);
  SHIFTMAP_RETURN_IF_ERROR(longer);
  return MakeStatus(
      StatusCode::kAlreadyExists, "area '{}': every run is already in the map", options_.area);
}

}  // namespace

StatusOr<LoadedRuns> LoadRuns(const RunLoaderOptions& options, const Context& context) {
  Loader loader(options, context);
  std::vector<ReadLog> files;
  for (const std::string& path : options.logs) {
    SHIFTMAP_RETURN_IF_ERROR(options.on_step());
    files.push_back({path, ChangedAt(path)});
    SHIFTMAP_RETURN_IF_ERROR(loader.Load(path));
  }
  SHIFTMAP_ASSIGN_OR_RETURN(LoadedRuns runs, loader.Finish());
  runs.files = std::move(files);
  return runs;
}

}  // namespace shiftmap
