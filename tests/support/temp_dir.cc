// SPDX-License-Identifier: Apache-2.0
#include "tests/support/temp_dir.h"

#include <sys/stat.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>

#include "proto/core/check.h"

namespace shiftmap::testing {

TempDir::TempDir() {
  std::string pattern = (std::filesystem::temp_directory_path() / "shiftmap-test-XXXXXX").string();
  SHIFTMAP_CHECK(mkdtemp(pattern.data()) != nullptr, "mkdtemp {}", pattern);
  path_ = pattern;
  // Readable for WithoutPrivilege.
  SHIFTMAP_CHECK(chmod(path_.c_str(), 0755) == 0, "chmod {}", path_);
}

TempDir::~TempDir() {
  std::error_code error;
  std::filesystem::remove_all(path_, error);
}

std::string ReadFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  SHIFTMAP_CHECK(file.good(), "cannot read {}", path);
  return {std::istreambuf_iterator<char>(file), std::istreambuf_iterator<char>()};
}

void WriteFile(const std::string& path, const std::string& bytes) {
  std::ofstream file(path, std::ios::binary | std::ios::trunc);
  file << bytes;
  file.close();
  SHIFTMAP_CHECK(file.good(), "cannot write {}", path);
}

WithoutPrivilege::WithoutPrivilege() {
  constexpr uid_t kNobody = 65534;
  if (geteuid() == 0) {
    SHIFTMAP_CHECK(seteuid(kNobody) == 0, "seteuid {}", kNobody);
    dropped_ = true;
  }
}

WithoutPrivilege::~WithoutPrivilege() {
  if (dropped_) SHIFTMAP_CHECK(seteuid(0) == 0, "seteuid 0");
}

}  // namespace shiftmap::testing
