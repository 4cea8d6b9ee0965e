// SPDX-License-Identifier: Apache-2.0
#include "mapper/cli/log_file.h"

#include <sys/stat.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

namespace shiftmap {

std::optional<Stamp> ChangedAt(const std::string& path) {
  struct stat status {};
  if (stat(path.c_str(), &status) != 0) return std::nullopt;
  return Stamp(std::chrono::seconds(status.st_ctim.tv_sec) +
               std::chrono::nanoseconds(status.st_ctim.tv_nsec));
}

std::string RunNameOf(const std::string& path, const std::vector<std::string>& paths) {
  const std::filesystem::path log(path);
  const std::string stem = log.stem().string();
  const bool shared = std::any_of(paths.begin(), paths.end(), [&](const std::string& other) {
    return other != path && std::filesystem::path(other).stem() == stem;
  });
  const std::string folder = log.parent_path().filename().string();
  return shared && !folder.empty() ? folder + "/" + stem : stem;
}

}  // namespace shiftmap
