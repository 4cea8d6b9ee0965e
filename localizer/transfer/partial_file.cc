// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/partial_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "mapstore/codec/snapshot_json.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/lock_file.h"

namespace shiftmap::transfer {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxDescriptionBytes = std::size_t{64} << 10;

Status ErrnoStatus(const char* action) {
  const StatusCode code = errno == ENOENT || errno == ENOTDIR ? StatusCode::kNotFound
                          : errno == EISDIR                   ? StatusCode::kInvalidArgument
                                                              : StatusCode::kUnavailable;
  return MakeStatus(code, "cannot {}: {}", action, std::strerror(errno));
}

// Opens and locks the file. Whoever had it before may have renamed it meanwhile.
StatusOr<OwnedFd> OpenLocked(const std::string& path) {
  for (;;) {
    OwnedFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC, 0666));
    struct stat info {};
    if (fd.get() < 0 || fstat(fd.get(), &info) != 0) return ErrnoStatus("open its partial file");
    if (!S_ISREG(info.st_mode)) return InvalidArgument("its partial file is not a regular file");
    if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
      return errno == EWOULDBLOCK ? Unavailable("another process fetches it")
                                  : ErrnoStatus("lock its partial file");
    }
    if (IsFileAt(fd.get(), path)) return fd;
  }
}

std::string Description(const SnapshotInfo& snapshot) {
  return SnapshotJson(snapshot).dump(2, ' ', false, Json::error_handler_t::replace) + "\n";
}

// Nothing if it is no description: whoever has the bytes begins anew then.
std::optional<SnapshotInfo> ReadDescription(const std::string& path) {
  const StatusOr<std::string> text = ReadInputFile("description", path, kMaxDescriptionBytes);
  if (!text.ok()) return std::nullopt;
  try {
    return SnapshotFromJson(Json::parse(*text));
  } catch (const Json::exception&) {
    return std::nullopt;
  }
}

}  // namespace

Status PartialFile::About(const Status& status) const {
  return Annotate(status, "snapshot '{}'", path_);
}

StatusOr<PartialFile> PartialFile::Open(const std::string& path) {
  PartialFile file(path, OwnedFd());
  struct stat info {};
  if (stat(path.c_str(), &info) == 0 && !S_ISREG(info.st_mode)) {
    return file.About(InvalidArgument("not a regular file"));
  }
  StatusOr<OwnedFd> fd = OpenLocked(file.part());
  if (!fd.ok()) return file.About(fd.status());
  file.fd_ = *std::move(fd);
  if (fstat(file.fd_.get(), &info) != 0) return file.About(ErrnoStatus("look at it"));
  file.of_ = ReadDescription(file.part() + ".json");
  file.size_bytes_ = info.st_size;
  if (!file.of_ || file.size_bytes_ > file.of_->size_bytes) {
    file.of_.reset();
    SHIFTMAP_RETURN_IF_ERROR(file.About(file.Truncate()));
  }
  return file;
}

Status PartialFile::Truncate() {
  if (ftruncate(fd_.get(), 0) != 0) return ErrnoStatus("truncate its partial file");
  size_bytes_ = 0;
  return OkStatus();
}

Status PartialFile::Begin(const SnapshotInfo& snapshot) {
  of_.reset();
  // In this order: the bytes are never of another snapshot than the description says.
  SHIFTMAP_RETURN_IF_ERROR(About(Truncate()));
  SHIFTMAP_RETURN_IF_ERROR(WriteFileAtomically(part() + ".json", Description(snapshot)));
  of_ = snapshot;
  return OkStatus();
}

Status PartialFile::Append(std::string_view bytes) {
  while (!bytes.empty()) {
    const ssize_t written = pwrite(fd_.get(), bytes.data(), bytes.size(), size_bytes_);
    if (written < 0 && errno == EINTR) continue;
    if (written < 0) return About(ErrnoStatus("write"));
    size_bytes_ += written;
    bytes.remove_prefix(static_cast<std::size_t>(written));
  }
  return OkStatus();
}

Status PartialFile::Place() {
  SHIFTMAP_RETURN_IF_ERROR(About(SyncAndRename(part(), path_)));
  unlink((part() + ".json").c_str());
  return OkStatus();
}

void PartialFile::Remove() {
  unlink((part() + ".json").c_str());
  unlink(part().c_str());
}

}  // namespace shiftmap::transfer
