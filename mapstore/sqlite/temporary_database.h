// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "mapstore/core/atomic_file.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A path for a database beside its destination, to be written and then renamed. The destructor
/// removes a file that was not renamed, and its journal; Create() removes those of a process that
/// was killed.
///
/// Not an AtomicFile itself: SQLite opens its database by name, and its locks and those of an
/// AtomicFile may be the same on a shared disk.
class TemporaryDatabase {
 public:
  /// Errors: as AtomicFile; messages start with `file 'DESTINATION': `.
  static StatusOr<TemporaryDatabase> Create(const std::string& destination);

  TemporaryDatabase(TemporaryDatabase&&) noexcept = default;
  TemporaryDatabase& operator=(TemporaryDatabase&&) = delete;
  ~TemporaryDatabase();

  /// No file is there at first.
  const std::string& path() const { return path_; }

 private:
  explicit TemporaryDatabase(AtomicFile claim);
  void Remove() const;

  AtomicFile claim_;  // Empty; whoever has it locked owns the names that begin with its own.
  std::string path_;
};

}  // namespace shiftmap
