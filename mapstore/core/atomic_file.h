// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "proto/core/status.h"

namespace shiftmap {

/// What a file holds, as far as others must not replace it: weeks of a site are in a map store, and
/// a run log is recorded once.
enum class FileKind { kOther, kRunLog, kDatabase };

/// A file that appears at its path whole or not at all. Bytes go to a temporary file in the same
/// folder; Commit() makes them durable and then renames it into place. Without Commit() the
/// temporary file is removed, and what was at the path stays.
///
/// A file that a killed process left is removed by the next that writes to the path; whoever is
/// alive holds a lock on its own.
///
/// Errors: kNotFound if the folder does not exist; kInvalidArgument if something other than a
/// regular file is at the path, or a run log or a database and the file is none; kUnavailable if
/// the disk does not take it. Messages say what failed; the caller puts the kind and name of the
/// file before it.
class AtomicFile {
 public:
  static StatusOr<AtomicFile> Create(const std::string& path, FileKind kind = FileKind::kOther);

  AtomicFile(AtomicFile&& other) noexcept;
  AtomicFile& operator=(AtomicFile&& other) noexcept;
  ~AtomicFile();

  Status Append(std::string_view bytes);

  /// Makes the file durable and visible. Call once, last.
  Status Commit();

  /// The same at another path in its folder, for a file whose name follows from its content.
  Status CommitAs(const std::string& path);

  /// False once it is committed or moved from.
  bool open() const { return fd_ >= 0; }

  /// Where the bytes are until then; no other AtomicFile has it meanwhile.
  const std::string& temporary() const { return temporary_; }

 private:
  AtomicFile(std::string path, std::string temporary, int fd);
  void Discard();

  std::string path_;
  std::string temporary_;
  int fd_ = -1;
};

/// Writes a whole file this way. Errors: as AtomicFile; messages start with `file 'PATH': `.
Status WriteFileAtomically(const std::string& path, std::string_view bytes);

/// Makes `temporary`, a file that somebody else wrote, durable and renames it to `path` in the same
/// folder. Errors: kNotFound, kUnavailable, as AtomicFile.
Status SyncAndRename(const std::string& temporary, const std::string& path);

/// Makes durable that a file came to `path` or was removed from there. Errors: as AtomicFile.
Status SyncFolderOf(const std::string& path);

}  // namespace shiftmap
