// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/atomic_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <cstdio>
#include <cstring>
#include <fstream>
#include <iterator>
#include <utility>

#include "mapstore/core/lock_file.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

Status ErrnoStatus(const char* action) {
  const int error = errno;
  const StatusCode code =
      error == ENOENT || error == ENOTDIR ? StatusCode::kNotFound : StatusCode::kUnavailable;
  return MakeStatus(code, "cannot {}: {}", action, std::strerror(error));
}

std::string FolderOf(const std::string& path) {
  const std::size_t slash = path.rfind('/');
  if (slash == std::string::npos) return ".";
  return slash == 0 ? "/" : path.substr(0, slash);
}

// By its first bytes; what cannot be read is kOther.
FileKind KindOf(const std::string& path) {
  constexpr std::string_view kMcap = "\x89MCAP0\r\n";
  constexpr std::string_view kSqlite{"SQLite format 3\0", 16};
  std::array<char, kSqlite.size()> bytes{};
  std::ifstream file(path, std::ios::binary);
  file.read(bytes.data(), std::ssize(bytes));
  const std::string_view head(bytes.data(), static_cast<std::size_t>(file.gcount()));
  if (head == kSqlite) return FileKind::kDatabase;
  return head.starts_with(kMcap) ? FileKind::kRunLog : FileKind::kOther;
}

// A rename is durable only once the folder is.
Status RenameAndSyncFolder(const std::string& temporary, const std::string& path) {
  if (std::rename(temporary.c_str(), path.c_str()) != 0) return ErrnoStatus("rename to it");
  return SyncFolderOf(path);
}

// Makes a file that nobody else has and locks it. Returns -1 with errno.
int CreateLocked(const std::string& path) {
  for (;;) {
    const int fd = open(path.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (fd < 0) return fd;
    // Where there are no locks, nobody takes the file for left behind either.
    const bool locked = flock(fd, LOCK_EX | LOCK_NB) == 0;
    if (locked ? IsFileAt(fd, path) : errno != EWOULDBLOCK) return fd;
    // Somebody took it for left behind before it was locked.
    close(fd);
  }
}

// Removes what a process left that is no more: nobody holds its lock. False if somebody does.
bool RemoveAbandoned(const std::string& path) {
  const int fd = open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC);
  if (fd < 0) return errno == ENOENT;
  struct stat info {};
  const bool regular = fstat(fd, &info) == 0 && S_ISREG(info.st_mode);
  const bool abandoned = regular && flock(fd, LOCK_EX | LOCK_NB) == 0;
  // The name may be another file's by now.
  const bool removed = abandoned && (!IsFileAt(fd, path) || unlink(path.c_str()) == 0);
  close(fd);
  return removed;
}

}  // namespace

AtomicFile::AtomicFile(std::string path, std::string temporary, int fd)
    : path_(std::move(path)), temporary_(std::move(temporary)), fd_(fd) {}

AtomicFile::AtomicFile(AtomicFile&& other) noexcept
    : path_(std::move(other.path_)),
      temporary_(std::move(other.temporary_)),
      fd_(std::exchange(other.fd_, -1)) {}

AtomicFile& AtomicFile::operator=(AtomicFile&& other) noexcept {
  if (this != &other) {
    Discard();
    path_ = std::move(other.path_);
    temporary_ = std::move(other.temporary_);
    fd_ = std::exchange(other.fd_, -1);
  }
  return *this;
}

AtomicFile::~AtomicFile() { Discard(); }

void AtomicFile::Discard() {
  if (fd_ < 0) return;
  // In this order: without the lock, the name may be somebody else's.
  unlink(temporary_.c_str());
  close(std::exchange(fd_, -1));
}

StatusOr<AtomicFile> AtomicFile::Create(const std::string& path, FileKind kind) {
  struct stat info {};
  if (stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) {
    return InvalidArgument("not a regular file");
  }
  const FileKind there = KindOf(path);
  if (there != FileKind::kOther && there != kind) {
    return InvalidArgument("{} is there, and is not replaced",
                           there == FileKind::kRunLog ? "a run log" : "a map store or a snapshot");
  }
  for (int number = 0;;) {
    std::string temporary = fmt::format("{}.tmp-{}", path, number);
    const int fd = CreateLocked(temporary);
    if (fd >= 0) return AtomicFile(path, std::move(temporary), fd);
    if (errno == ENOENT) return NotFound("its folder does not exist");
    if (errno != EEXIST) return ErrnoStatus("create a file beside it");
    if (!RemoveAbandoned(temporary)) ++number;
  }
}

Status AtomicFile::Append(std::string_view bytes) {
  SHIFTMAP_CHECK(fd_ >= 0, "'{}' is committed", path_);
  while (!bytes.empty()) {
    const ssize_t written = write(fd_, bytes.data(), bytes.size());
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return ErrnoStatus("write");
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return OkStatus();
}

Status AtomicFile::Commit() { return CommitAs(path_); }

Status AtomicFile::CommitAs(const std::string& path) {
  SHIFTMAP_CHECK(fd_ >= 0, "'{}' is committed", path_);
  if (fsync(fd_) != 0) return ErrnoStatus("sync");
  SHIFTMAP_RETURN_IF_ERROR(RenameAndSyncFolder(temporary_, path));
  close(std::exchange(fd_, -1));
  return OkStatus();
}

Status WriteFileAtomically(const std::string& path, std::string_view bytes) {
  const auto write = [&]() -> Status {
    SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile file, AtomicFile::Create(path));
    SHIFTMAP_RETURN_IF_ERROR(file.Append(bytes));
    return file.Commit();
  };
  return Annotate(write(), "file '{}'", path);
}

Status SyncFolderOf(const std::string& path) {
  const int fd = open(FolderOf(path).c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
  if (fd < 0) return ErrnoStatus("open its folder");
  const Status status = fsync(fd) == 0 ? OkStatus() : ErrnoStatus("sync its folder");
  close(fd);
  return status;
}

Status SyncAndRename(const std::string& temporary, const std::string& path) {
  const int fd = open(temporary.c_str(), O_RDWR | O_CLOEXEC);
  if (fd < 0) return ErrnoStatus("open the temporary file");
  const Status status = fsync(fd) == 0 ? OkStatus() : ErrnoStatus("sync the temporary file");
  close(fd);
  SHIFTMAP_RETURN_IF_ERROR(status);
  return RenameAndSyncFolder(temporary, path);
}

}  // namespace shiftmap
