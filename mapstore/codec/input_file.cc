// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/input_file.h"

#include <filesystem>

namespace shiftmap {

StatusOr<std::ifstream> OpenInputFile(const std::string& path) {
  std::error_code error;
  const auto kind = std::filesystem::status(path, error).type();
  if (kind == std::filesystem::file_type::not_found) return NotFound("does not exist");
  if (kind == std::filesystem::file_type::directory) {
    return InvalidArgument("is a folder, expected a file");
  }
  std::ifstream file(path, std::ios::binary);
  if (!file) return Unavailable("cannot be opened for reading");
  return file;
}

}  // namespace shiftmap
