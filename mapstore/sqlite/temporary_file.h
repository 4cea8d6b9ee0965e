// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace shiftmap {

/// The path of a file beside another one, to be written and then renamed to it. What is there at
/// the end of the object is removed, with the journal that SQLite may leave beside it.
class TemporaryFile {
 public:
  explicit TemporaryFile(const std::string& destination);

  /// With a name that is always the same: what a process that was killed left there is removed. For
  /// who keeps others out by a lock.
  static TemporaryFile Exclusive(const std::string& destination);

  ~TemporaryFile();
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;

  const std::string& path() const { return path_; }

 private:
  TemporaryFile(const std::string& destination, const std::string& suffix);
  void Remove();

  std::string path_;
};

}  // namespace shiftmap
