// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/temporary_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

namespace shiftmap {

TemporaryFile::TemporaryFile(const std::string& destination)
    : TemporaryFile(destination, fmt::format("{}", getpid())) {}

TemporaryFile::TemporaryFile(const std::string& destination, const std::string& suffix)
    : path_(fmt::format("{}.tmp-{}", destination, suffix)) {
  Remove();
}

TemporaryFile TemporaryFile::Exclusive(const std::string& destination) {
  return {destination, "new"};
}

TemporaryFile::~TemporaryFile() { Remove(); }

void TemporaryFile::Remove() {
  std::error_code error;
  std::filesystem::remove(path_, error);
  std::filesystem::remove(path_ + "-journal", error);
}

}  // namespace shiftmap
