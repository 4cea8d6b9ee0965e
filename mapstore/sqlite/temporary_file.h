// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// The path of a file beside another one, to be written and then renamed to it. What is there at
/// the end of the object is removed, with the journal that SQLite may leave beside it.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& destination);
  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  void Remove();

  std::string path_;
};

}  // namespace shiftmap
