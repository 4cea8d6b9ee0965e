// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/log_limits.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <utility>

#include "mapper/cli/area_build.h"
#include "mapstore/cli/store_access.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/day.h"

namespace shiftmap {
namespace {

constexpr double kMib = 1024.0 * 1024.0;

struct LogFile {
  std::string path;
  Stamp begin;
  double bytes = 0.0;
  double age_days = 0.0;
};

void AddFile(const std::string& path, Stamp begin, std::vector<LogFile>* files) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return;
  const Stamp written = Stamp(std::chrono::seconds(status.st_mtim.tv_sec));
  files->push_back({path,
                    begin,
                    static_cast<double>(status.st_size),
                    ToSeconds(SystemNow() - written) / kSecondsPerDay});
}

// The logs that may go: the map has them now, or nobody wants them.
StatusOr<std::vector<LogFile>> FindDone(const NightOptions& options,
                                        const Context& context,
                                        const NightWork& work) {
  std::vector<LogFile> done;
  for (const std::string& path : work.ignored) AddFile(path, Stamp(), &done);
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store,
                            OpenStore(options.build.store, MapStore::Access::kReadOnly, context));
  for (const auto& [area, logs] : work.areas) {
    std::vector<LogHead> all = logs.excluded;
    for (const auto* const kind : {&logs.fresh, &logs.waiting, &logs.again, &logs.mapped}) {
      all.insert(all.end(), kind->begin(), kind->end());
    }
    SHIFTMAP_ASSIGN_OR_RETURN(const AreaLogs now, SortLogs(area, std::move(all), &store));
    for (const auto* const kind : {&now.mapped, &now.excluded}) {
      for (const LogHead& log : *kind) AddFile(log.path, log.begin, &done);
    }
  }
  std::sort(done.begin(), done.end(), [](const LogFile& a, const LogFile& b) {
    return std::tie(a.begin, a.path) < std::tie(b.begin, b.path);
  });
  return done;
}

Status Delete(const std::string& path) {
  std::error_code error;
  std::filesystem::remove(path, error);
  if (!error) return OkStatus();
  return Unavailable("run log '{}': cannot be deleted: {}", path, error.message());
}

}  // namespace

StatusOr<std::vector<std::string>> KeepLogLimits(const NightOptions& options,
                                                 const Context& context,
                                                 NightWork* work) {
  std::error_code error;
  if ((!options.log_quota_mib && !options.log_max_age_days) ||
      !std::filesystem::exists(options.build.store, error)) {
    return std::vector<std::string>();
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<std::string> paths, FindFiles(options.logs, ".mcap"));
  std::vector<LogFile> all;
  for (const std::string& path : paths) AddFile(path, Stamp(), &all);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<LogFile> done, FindDone(options, context, *work));
  double bytes = 0.0;
  for (const LogFile& file : all) bytes += file.bytes;
  const double quota =
      options.log_quota_mib ? static_cast<double>(*options.log_quota_mib) * kMib : bytes;
  std::set<std::string> deleted;
  const auto is_old = [&](const LogFile& file) {
    return options.log_max_age_days && file.age_days > *options.log_max_age_days;
  };
  // By age first: what is deleted so counts for the quota.
  for (const bool by_age : {true, false}) {
    for (const LogFile& file : done) {
      if (deleted.contains(file.path) || (by_age ? !is_old(file) : bytes <= quota)) continue;
      if (!context.dry_run()) SHIFTMAP_RETURN_IF_ERROR(Delete(file.path));
      deleted.insert(file.path);
      bytes -= file.bytes;
    }
  }
  std::vector<std::string> paths_deleted(deleted.begin(), deleted.end());
  // What the night would map may go then, too.
  if (context.dry_run()) return paths_deleted;
  const auto kept = std::count_if(all.begin(), all.end(), [&](const LogFile& file) {
    return is_old(file) && !deleted.contains(file.path);
  });
  if (kept > 0) {
    work->left.push_back(fmt::format("{} beyond the age of {} days and in no map: not deleted",
                                     CountText(kept, "log"),
                                     *options.log_max_age_days));
  }
  if (bytes > quota) {
    work->left.push_back(
        fmt::format("log folder '{}' has {:.1f} MiB, allowed are {}: what is left is in no map and "
                    "stays",
                    options.logs,
                    bytes / kMib,
                    *options.log_quota_mib));
  }
  return paths_deleted;
}

}  // namespace shiftmap
