// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/lock_file.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <cerrno>
#include <system_error>
#include <utility>

namespace shiftmap {

StatusCode PathErrorCode(int error) {
  switch (error) {
    case ENOENT:
      return StatusCode::kNotFound;
    case ENOTDIR:
    case ENAMETOOLONG:
    case ELOOP:
    case EINVAL:
      return StatusCode::kInvalidArgument;
    default:
      return StatusCode::kUnavailable;
  }
}

StatusOr<std::optional<OwnedFd>> LockFile(const std::string& path) {
  constexpr mode_t kAccess = 0640;
  OwnedFd fd(open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, kAccess));
  if (fd.get() < 0) {
    const std::error_code error(errno, std::generic_category());
    return MakeStatus(
        PathErrorCode(error.value()), "lock '{}': cannot be opened: {}", path, error.message());
  }
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) return std::optional<OwnedFd>();
  return std::optional(std::move(fd));
}

bool IsFileAt(int fd, const std::string& path) {
  struct stat open_file {};
  struct stat at_path {};
  return fstat(fd, &open_file) == 0 && lstat(path.c_str(), &at_path) == 0 &&
         open_file.st_dev == at_path.st_dev && open_file.st_ino == at_path.st_ino;
}

}  // namespace shiftmap
