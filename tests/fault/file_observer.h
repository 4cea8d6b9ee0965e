// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

namespace shiftmap::testing {

enum class FileOperation {
  kOpen,
  kRead,
  kWrite,
  kTruncate,
  kSync,
  kSyncFolder,
  kDelete,
  kRename,
  kAccess,  ///< Existence, size.
  kLock,
};

/// One request to the file system, before it is carried out.
struct FileEvent {
  FileOperation operation;
  std::string path;          ///< Of the folder for kSyncFolder.
  std::string target{};      ///< kRename: the destination.
  std::int64_t offset = 0;   ///< kWrite: where. kTruncate: the size. [byte]
  std::string_view bytes{};  ///< kWrite.
  bool creates = false;      ///< kOpen: the file was not there.
};

/// What becomes of a request.
struct Verdict {
  int code = 0;            ///< An SQLite result code; SQLITE_OK: carry it out.
  bool half_done = false;  ///< A write that fails leaves the first half of its bytes.
};

/// Sees every request that the code under test makes of the file system while it is the current
/// one: those of SQLite (observed_vfs.cc) and those of our own code (posix_wraps.cc). Threads: one.
class FileObserver {
 public:
  FileObserver() = default;
  virtual ~FileObserver() = default;
  FileObserver(const FileObserver&) = delete;
  FileObserver& operator=(const FileObserver&) = delete;

  virtual Verdict On(const FileEvent& event) = 0;
};

/// Makes SQLite use a VFS that asks the observer and never really syncs, and makes the observer the
/// current one, as long as it lives. Files opened meanwhile may outlive it; then nobody is asked.
class ObservedFiles {
 public:
  explicit ObservedFiles(FileObserver& observer);
  ~ObservedFiles();
  ObservedFiles(const ObservedFiles&) = delete;
  ObservedFiles& operator=(const ObservedFiles&) = delete;
};

/// The current observer's verdict; OK if there is none.
Verdict AskObserver(const FileEvent& event);

/// True if requests are observed now.
bool HasObserver();

/// The folder that a path is in.
std::string FolderOfPath(const std::string& path);

}  // namespace shiftmap::testing
