// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/folder.h"

#include <filesystem>
#include <system_error>

namespace shiftmap {

Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  if (!error) return OkStatus();
  const bool in_the_way = error == std::errc::not_a_directory || error == std::errc::file_exists;
  return MakeStatus(in_the_way ? StatusCode::kInvalidArgument : StatusCode::kUnavailable,
                    "folder '{}': cannot be made: {}",
                    path,
                    error.message());
}

}  // namespace shiftmap
