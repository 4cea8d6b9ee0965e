// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>

#include "mapstore/core/owned_fd.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Makes a folder, and those above it, unless it is there.
///
/// Errors: kInvalidArgument if something else than a folder is at the path or at one above it;
/// kUnavailable if the disk does not take it or nothing may be written in the folder. Messages
/// start with `folder 'PATH': `.
Status MakeFolder(const std::string& path);

/// Whether MakeFolder() would make the folder and let write in it, as far as permissions tell, for
/// what works long before it writes. Makes nothing. Errors as MakeFolder().
Status CheckFolder(const std::string& path);

/// A new folder for files that do not outlive it: it is removed with all that is in it.
class ScratchFolder {
 public:
  /// In a folder, or in that of the system for temporary files. Errors: kUnavailable.
  static StatusOr<ScratchFolder> Make(const std::string& parent = "");

  ScratchFolder(ScratchFolder&& other) noexcept : path_(std::exchange(other.path_, "")) {}
  ScratchFolder& operator=(ScratchFolder&&) = delete;
  ~ScratchFolder();

  const std::string& path() const { return path_; }

 private:
  explicit ScratchFolder(std::string path) : path_(std::move(path)) {}

  std::string path_;
};

/// Holds a folder against other FolderLocks of it, in this process and in others, while it lives.
class FolderLock {
 public:
  /// Waits for whoever holds it. Errors: kNotFound if there is no such folder; kUnavailable if it
  /// cannot be read or locked.
  static StatusOr<FolderLock> Take(const std::string& path);

 private:
  explicit FolderLock(OwnedFd fd) : fd_(std::move(fd)) {}

  OwnedFd fd_;
};

}  // namespace shiftmap
