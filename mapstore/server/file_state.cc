// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/file_state.h"

#include <fmt/format.h>
#include <sys/stat.h>

namespace shiftmap::server {

std::string FileState(const std::string& path) {
  struct stat info {};
  if (stat(path.c_str(), &info) != 0) return "none";
  return fmt::format(
      "{} {} {}.{}", info.st_ino, info.st_size, info.st_mtim.tv_sec, info.st_mtim.tv_nsec);
}

}  // namespace shiftmap::server
