// SPDX-License-Identifier: Apache-2.0
//
// The linker sends our own code's calls of open, write, fsync and rename here (--wrap in
// CMakeLists.txt); SQLite's come through its VFS. The observer is asked first.
#include <fcntl.h>
#include <sqlite3.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <climits>
#include <cstdarg>
#include <string>

#include "tests/fault/file_observer.h"

extern "C" {
int __real_open(const char* path, int flags, ...);
ssize_t __real_write(int fd, const void* bytes, size_t size);
int __real_fsync(int fd);
int __real_rename(const char* from, const char* to);

int __wrap_open(const char* path, int flags, ...);
ssize_t __wrap_write(int fd, const void* bytes, size_t size);
int __wrap_fsync(int fd);
int __wrap_rename(const char* from, const char* to);
}

namespace {

using shiftmap::testing::AskObserver;
using shiftmap::testing::FileEvent;
using shiftmap::testing::FileOperation;
using shiftmap::testing::HasObserver;

std::string PathOf(int fd) {
  char path[PATH_MAX];
  const std::string link = "/proc/self/fd/" + std::to_string(fd);
  const ssize_t size = readlink(link.c_str(), path, sizeof path);
  return size < 0 ? std::string() : std::string(path, static_cast<std::size_t>(size));
}

bool IsFolder(int fd) {
  struct stat info {};
  return fstat(fd, &info) == 0 && S_ISDIR(info.st_mode);
}

// True if the observer lets the call pass; otherwise errno is set.
bool Passes(const FileEvent& event) {
  switch (AskObserver(event).code) {
    case SQLITE_OK:
      return true;
    case SQLITE_FULL:
      errno = ENOSPC;
      return false;
    default:
      errno = EIO;
      return false;
  }
}

}  // namespace

int __wrap_open(const char* path, int flags, ...) {
  va_list arguments;
  va_start(arguments, flags);
  const int mode = (flags & O_CREAT) != 0 ? va_arg(arguments, int) : 0;
  va_end(arguments);
  if (HasObserver()) {
    const bool creates = (flags & O_CREAT) != 0 && access(path, F_OK) != 0;
    if (!Passes({.operation = FileOperation::kOpen, .path = path, .creates = creates})) return -1;
  }
  return __real_open(path, flags, mode);
}

ssize_t __wrap_write(int fd, const void* bytes, size_t size) {
  if (HasObserver()) {
    const off_t offset = lseek(fd, 0, SEEK_CUR);
    if (offset >= 0 && !Passes({.operation = FileOperation::kWrite,
                                .path = PathOf(fd),
                                .target = {},
                                .offset = offset,
                                .bytes = {static_cast<const char*>(bytes), size}})) {
      return -1;
    }
  }
  return __real_write(fd, bytes, size);
}

int __wrap_fsync(int fd) {
  if (!HasObserver()) return __real_fsync(fd);
  const FileOperation operation = IsFolder(fd) ? FileOperation::kSyncFolder : FileOperation::kSync;
  return Passes({.operation = operation, .path = PathOf(fd)}) ? 0 : -1;
}

int __wrap_rename(const char* from, const char* to) {
  if (HasObserver() && !Passes({.operation = FileOperation::kRename, .path = from, .target = to})) {
    return -1;
  }
  return __real_rename(from, to);
}
