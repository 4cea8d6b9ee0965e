// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap::testing {

/// A fresh folder that is removed with all that is in it.
class TempDir {
 public:
  TempDir();
  ~TempDir();
  TempDir(const TempDir&) = delete;
  TempDir& operator=(const TempDir&) = delete;

  const std::string& path() const { return path_; }

  /// The path of a file in it.
  std::string File(const std::string& name) const { return path_ + "/" + name; }

 private:
  std::string path_;
};

/// The bytes of a file; aborts if it cannot be read.
std::string ReadFile(const std::string& path);

/// Makes or replaces a file; aborts if it cannot be written.
void WriteFile(const std::string& path, const std::string& bytes);

/// Runs as a user without rights over others' files as long as it lives, even under root.
class WithoutPrivilege {
 public:
  WithoutPrivilege();
  ~WithoutPrivilege();
  WithoutPrivilege(const WithoutPrivilege&) = delete;
  WithoutPrivilege& operator=(const WithoutPrivilege&) = delete;

 private:
  bool dropped_ = false;
};

}  // namespace shiftmap::testing
