// SPDX-License-Identifier: Apache-2.0
#include "mapper/nightly/fleet_folder.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <optional>
#include <system_error>

#include "mapstore/codec/run_log.h"
#include "mapstore/map/sha256.h"

namespace shiftmap {

StatusOr<std::vector<std::string>> FindFiles(const std::string& folder,
                                             const std::string& ending,
                                             std::vector<std::string>* unreadable) {
  namespace fs = std::filesystem;
  std::error_code error;
  std::vector<std::string> paths;
  if (!fs::exists(folder, error)) return NotFound("folder '{}': does not exist", folder);
  if (!fs::is_directory(folder, error)) return InvalidArgument("folder '{}': is a file", folder);
  fs::recursive_directory_iterator at(folder, error);
  for (; !error && at != fs::recursive_directory_iterator(); at.increment(error)) {
    std::error_code unknown;
    if (at->is_directory(unknown) && !at->is_symlink(unknown) &&
        faccessat(AT_FDCWD, at->path().c_str(), R_OK | X_OK, AT_EACCESS) != 0) {
      if (unreadable != nullptr) unreadable->push_back(at->path().string());
      at.disable_recursion_pending();
      continue;
    }
    if (at->path().filename().string().ends_with(ending) && at->is_regular_file(unknown)) {
      paths.push_back(at->path().string());
    }
  }
  if (error) return Unavailable("folder '{}': {}", folder, error.message());
  std::sort(paths.begin(), paths.end());
  return paths;
}

StatusOr<LogHead> ReadLogHead(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path, false));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<RunEvent> first, stream.Next());
  if (!first) return InvalidArgument("run log '{}': no item", path);
  LogHead head{path, stream.info(), StampOf(*first), {}};
  if (head.info.uuid.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(head.sha256, HashFile(path));
  }
  return head;
}

}  // namespace shiftmap
