// SPDX-License-Identifier: Apache-2.0
#include "mapstore/sqlite/temporary_file.h"

#include <fmt/format.h>
#include <unistd.h>

#include <filesystem>

namespace shiftmap {

TemporaryFile::TemporaryFile(const std::string& destination)
    : path_(fmt::format("{}.tmp-{}", destination, getpid())) {
  Remove();
}

TemporaryFile::~TemporaryFile() { Remove(); }

void TemporaryFile::Remove() {
  std::error_code error;
  std::filesystem::remove(path_, error);
  std::filesystem::remove(path_ + "-journal", error);
}

}  // namespace shiftmap
