// SPDX-License-Identifier: Apache-2.0
//
// An SQLite VFS that wraps the default one and asks the current observer before every request.
#include <sqlite3.h>
#include <sys/stat.h>

#include <cstdint>
#include <new>

#include "proto/core/check.h"
#include "tests/fault/file_observer.h"

namespace shiftmap::testing {
namespace {

FileObserver* current_observer = nullptr;

// Followed in memory by the wrapped VFS's file.
struct ObservedFile {
  sqlite3_file base;
  const char* path;      // SQLite keeps it until the file is closed; null for a nameless file.
  bool folder_sync_due;  // A new journal: its first sync makes its name durable.
  sqlite3_file* wrapped() { return reinterpret_cast<sqlite3_file*>(this + 1); }
};

ObservedFile* Observed(sqlite3_file* file) { return reinterpret_cast<ObservedFile*>(file); }
sqlite3_file* Wrapped(sqlite3_file* file) { return Observed(file)->wrapped(); }

// Nameless files are gone with their process, whatever happens.
Verdict Ask(sqlite3_file* file,
            FileOperation operation,
            std::int64_t offset = 0,
            std::string_view bytes = {}) {
  const char* path = Observed(file)->path;
  if (path == nullptr) return {};
  return AskObserver(
      {.operation = operation, .path = path, .target = {}, .offset = offset, .bytes = bytes});
}

int Close(sqlite3_file* file) {
  sqlite3_file* wrapped = Wrapped(file);
  return wrapped->pMethods == nullptr ? SQLITE_OK : wrapped->pMethods->xClose(wrapped);
}

int Read(sqlite3_file* file, void* into, int size, sqlite3_int64 offset) {
  const int code = Ask(file, FileOperation::kRead, offset).code;
  if (code != SQLITE_OK) return code;
  return Wrapped(file)->pMethods->xRead(Wrapped(file), into, size, offset);
}

int Write(sqlite3_file* file, const void* from, int size, sqlite3_int64 offset) {
  const std::string_view bytes(static_cast<const char*>(from), static_cast<std::size_t>(size));
  const Verdict verdict = Ask(file, FileOperation::kWrite, offset, bytes);
  const bool whole = verdict.code == SQLITE_OK;
  if (!whole && !verdict.half_done) return verdict.code;
  const int code =
      Wrapped(file)->pMethods->xWrite(Wrapped(file), from, whole ? size : size / 2, offset);
  return whole ? code : verdict.code;
}

int Truncate(sqlite3_file* file, sqlite3_int64 size) {
  const int code = Ask(file, FileOperation::kTruncate, size).code;
  if (code != SQLITE_OK) return code;
  return Wrapped(file)->pMethods->xTruncate(Wrapped(file), size);
}

int Sync(sqlite3_file* file, int /*flags*/) {
  const int code = Ask(file, FileOperation::kSync).code;
  if (code != SQLITE_OK || !Observed(file)->folder_sync_due) return code;
  Observed(file)->folder_sync_due = false;
  // As the default VFS, which ignores that this fails.
  AskObserver(
      {.operation = FileOperation::kSyncFolder, .path = FolderOfPath(Observed(file)->path)});
  return SQLITE_OK;
}

int FileSize(sqlite3_file* file, sqlite3_int64* size) {
  const int code = Ask(file, FileOperation::kAccess).code;
  if (code != SQLITE_OK) return SQLITE_IOERR_FSTAT;
  return Wrapped(file)->pMethods->xFileSize(Wrapped(file), size);
}

int Lock(sqlite3_file* file, int level) {
  const int code = Ask(file, FileOperation::kLock).code;
  if (code != SQLITE_OK) return code;
  return Wrapped(file)->pMethods->xLock(Wrapped(file), level);
}

int Unlock(sqlite3_file* file, int level) {
  return Wrapped(file)->pMethods->xUnlock(Wrapped(file), level);
}

int CheckReservedLock(sqlite3_file* file, int* result) {
  const int code = Ask(file, FileOperation::kLock).code;
  if (code != SQLITE_OK) return SQLITE_IOERR_CHECKRESERVEDLOCK;
  return Wrapped(file)->pMethods->xCheckReservedLock(Wrapped(file), result);
}

int FileControl(sqlite3_file* file, int operation, void* argument) {
  return Wrapped(file)->pMethods->xFileControl(Wrapped(file), operation, argument);
}

int SectorSize(sqlite3_file* file) { return Wrapped(file)->pMethods->xSectorSize(Wrapped(file)); }

int DeviceCharacteristics(sqlite3_file* file) {
  return Wrapped(file)->pMethods->xDeviceCharacteristics(Wrapped(file));
}

// Version 1: neither shared memory nor memory mapping, which would bypass the observer.
constexpr sqlite3_io_methods kMethods = {.iVersion = 1,
                                         .xClose = Close,
                                         .xRead = Read,
                                         .xWrite = Write,
                                         .xTruncate = Truncate,
                                         .xSync = Sync,
                                         .xFileSize = FileSize,
                                         .xLock = Lock,
                                         .xUnlock = Unlock,
                                         .xCheckReservedLock = CheckReservedLock,
                                         .xFileControl = FileControl,
                                         .xSectorSize = SectorSize,
                                         .xDeviceCharacteristics = DeviceCharacteristics,
                                         .xShmMap = nullptr,
                                         .xShmLock = nullptr,
                                         .xShmBarrier = nullptr,
                                         .xShmUnmap = nullptr,
                                         .xFetch = nullptr,
                                         .xUnfetch = nullptr};

sqlite3_vfs* DefaultVfs() {
  static sqlite3_vfs* vfs = sqlite3_vfs_find("unix");
  return vfs;
}

bool Exists(const char* path) {
  struct stat info {};
  return stat(path, &info) == 0;
}

int Open(sqlite3_vfs* /*vfs*/, const char* path, sqlite3_file* file, int flags, int* out_flags) {
  auto* observed = new (file) ObservedFile{{nullptr}, path, false};
  observed->wrapped()->pMethods = nullptr;
  if (path != nullptr) {
    const bool creates = (flags & SQLITE_OPEN_CREATE) != 0 && !Exists(path);
    const int verdict =
        AskObserver({.operation = FileOperation::kOpen, .path = path, .creates = creates}).code;
    if (verdict != SQLITE_OK) return verdict;
    observed->folder_sync_due =
        (flags & SQLITE_OPEN_CREATE) != 0 &&
        (flags & (SQLITE_OPEN_MAIN_JOURNAL | SQLITE_OPEN_SUPER_JOURNAL)) != 0;
  }
  const int code = DefaultVfs()->xOpen(DefaultVfs(), path, observed->wrapped(), flags, out_flags);
  // SQLite closes the file if it has methods.
  if (code == SQLITE_OK) observed->base.pMethods = &kMethods;
  return code;
}

int Delete(sqlite3_vfs* /*vfs*/, const char* path, int sync_folder) {
  int code = AskObserver({.operation = FileOperation::kDelete, .path = path}).code;
  if (code != SQLITE_OK) return code;
  code = DefaultVfs()->xDelete(DefaultVfs(), path, 0);
  if (code != SQLITE_OK || sync_folder == 0) return code;
  return AskObserver({.operation = FileOperation::kSyncFolder, .path = FolderOfPath(path)}).code;
}

int Access(sqlite3_vfs* /*vfs*/, const char* path, int flags, int* result) {
  const int code = AskObserver({.operation = FileOperation::kAccess, .path = path}).code;
  if (code != SQLITE_OK) return code;
  return DefaultVfs()->xAccess(DefaultVfs(), path, flags, result);
}

// Lives as long as the process, so that files may outlive the scope that made them.
sqlite3_vfs* ObservedVfs() {
  static sqlite3_vfs vfs = [] {
    sqlite3_vfs made = *DefaultVfs();
    made.szOsFile += static_cast<int>(sizeof(ObservedFile));
    made.pNext = nullptr;
    made.zName = "shiftmap-observed";
    made.xOpen = Open;
    made.xDelete = Delete;
    made.xAccess = Access;
    return made;
  }();
  return &vfs;
}

}  // namespace

ObservedFiles::ObservedFiles(FileObserver& observer) {
  SHIFTMAP_CHECK(current_observer == nullptr, "files are observed already");
  SHIFTMAP_CHECK(sqlite3_initialize() == SQLITE_OK, "sqlite3_initialize");
  SHIFTMAP_CHECK(sqlite3_vfs_register(ObservedVfs(), 1) == SQLITE_OK, "sqlite3_vfs_register");
  current_observer = &observer;
}

ObservedFiles::~ObservedFiles() {
  current_observer = nullptr;
  sqlite3_vfs_register(DefaultVfs(), 1);
}

bool HasObserver() { return current_observer != nullptr; }

Verdict AskObserver(const FileEvent& event) {
  return current_observer == nullptr ? Verdict{} : current_observer->On(event);
}

std::string FolderOfPath(const std::string& path) { return path.substr(0, path.rfind('/')); }

}  // namespace shiftmap::testing
