// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/input_file.h"

#include <algorithm>
#include <array>
#include <filesystem>

namespace shiftmap {
namespace {

StatusOr<std::string> ReadWhole(const std::string& path, std::size_t max_bytes) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream file, OpenInputFile(path));
  std::string bytes;
  std::array<char, 1 << 16> buffer{};
  while (file.read(buffer.data(), buffer.size()) || file.gcount() > 0) {
    bytes.append(buffer.data(), static_cast<std::size_t>(file.gcount()));
    if (bytes.size() > max_bytes) return InvalidArgument("above {} bytes", max_bytes);
  }
  if (!file.eof()) return Unavailable("cannot be read");
  return bytes;
}

}  // namespace

StatusOr<std::ifstream> OpenInputFile(const std::string& path) {
  std::error_code error;
  const auto kind = std::filesystem::status(path, error).type();
  if (kind == std::filesystem::file_type::not_found) return NotFound("does not exist");
  if (kind == std::filesystem::file_type::directory) {
    return InvalidArgument("is a folder, expected a file");
  }
  if (kind == std::filesystem::file_type::none) return Unavailable("{}", error.message());
  if (kind != std::filesystem::file_type::regular) return InvalidArgument("not a regular file");
  std::ifstream file(path, std::ios::binary);
  if (!file) return Unavailable("cannot be opened for reading");
  // Some files of /proc look regular and have nothing to read.
  file.peek();
  if (file.bad()) return InvalidArgument("cannot be read");
  file.clear();
  return file;
}

StatusOr<std::string> ReadInputFile(std::string_view kind,
                                    const std::string& path,
                                    std::size_t max_bytes) {
  StatusOr<std::string> bytes = ReadWhole(path, max_bytes);
  if (bytes.ok()) return bytes;
  return Annotate(bytes.status(), "{} '{}'", kind, path);
}

bool TakeLine(std::string_view* text, std::string_view* line) {
  if (text->empty()) return false;
  const std::size_t end = text->find('\n');
  *line = text->substr(0, end);
  text->remove_prefix(std::min(text->size(), line->size() + 1));
  return true;
}

}  // namespace shiftmap
