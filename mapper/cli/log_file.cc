// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/log_file.h"

#include <sys/stat.h>

#include <chrono>
#include <filesystem>

namespace shiftmap {

std::optional<Stamp> ChangedAt(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return std::nullopt;
  return Stamp(std::chrono::seconds(status.st_ctim.tv_sec) +
               std::chrono::nanoseconds(status.st_ctim.tv_nsec));
}

RunNames::RunNames(const std::vector<std::string>& paths) {
  for (const std::string& path : paths) {
    paths_[std::filesystem::path(path).stem().string()].insert(path);
  }
}

std::string RunNames::Of(const std::string& path) const {
  const std::filesystem::path log(path);
  const std::string stem = log.stem().string();
  const std::string folder = log.parent_path().filename().string();
  const auto named = paths_.find(stem);
  const bool shared = named != paths_.end() && named->second.size() > 1;
  return shared && !folder.empty() ? folder + "/" + stem : stem;
}

}  // namespace shiftmap
