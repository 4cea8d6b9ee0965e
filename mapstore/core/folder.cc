// SPDX-License-Identifier: Apache-2.0
#include "mapstore/core/folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <system_error>
#include <utility>

namespace shiftmap {
namespace {

Status CannotBeMade(const std::string& path, const std::error_code& error) {
  const bool in_the_way = error == std::errc::not_a_directory || error == std::errc::file_exists;
  return MakeStatus(in_the_way ? StatusCode::kInvalidArgument : StatusCode::kUnavailable,
                    "folder '{}': cannot be made: {}",
                    path,
                    error.message());
}

Status CheckAccess(const std::string& path, const std::string& existing) {
  if (faccessat(AT_FDCWD, existing.c_str(), W_OK | X_OK, AT_EACCESS) == 0) return OkStatus();
  const std::error_code error(errno, std::generic_category());
  return MakeStatus(
      StatusCode::kUnavailable, "folder '{}': cannot be written to: {}", path, error.message());
}

}  // namespace

Status CheckFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::path existing = std::filesystem::absolute(path, error);
  while (!error && existing.has_relative_path() && !std::filesystem::exists(existing, error)) {
    existing = existing.parent_path();
  }
  if (!error && !std::filesystem::is_directory(existing, error)) {
    error = std::make_error_code(std::errc::not_a_directory);
  }
  return error ? CannotBeMade(path, error) : CheckAccess(path, existing.string());
}

Status MakeFolder(const std::string& path) {
  std::error_code error;
  std::filesystem::create_directories(path, error);
  return error ? CannotBeMade(path, error) : CheckAccess(path, path);
}

StatusOr<ScratchFolder> ScratchFolder::Make(const std::string& parent) {
  std::error_code error;
  std::filesystem::path path = parent;
  if (parent.empty()) path = std::filesystem::temp_directory_path(error);
  std::string made = (path / "shiftmap-XXXXXX").string();
  if (!error && mkdtemp(made.data()) == nullptr) {
    error = std::error_code(errno, std::generic_category());
  }
  if (error) return Unavailable("folder '{}': cannot be made: {}", made, error.message());
  return ScratchFolder(std::move(made));
}

ScratchFolder::~ScratchFolder() {
  std::error_code error;
  if (!path_.empty()) std::filesystem::remove_all(path_, error);
}

StatusOr<FolderLock> FolderLock::Take(const std::string& path) {
  FolderLock lock(OwnedFd(open(path.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC)));
  int failed = lock.fd_.get() < 0 ? -1 : 0;
  if (failed == 0) {
    do {
      failed = flock(lock.fd_.get(), LOCK_EX);
    } while (failed != 0 && errno == EINTR);
  }
  if (failed == 0) return lock;
  const std::error_code error(errno, std::generic_category());
  return MakeStatus(error == std::errc::no_such_file_or_directory ? StatusCode::kNotFound
                                                                  : StatusCode::kUnavailable,
                    "folder '{}': cannot be locked: {}",
                    path,
                    error.message());
}

}  // namespace shiftmap
