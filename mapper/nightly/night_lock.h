// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/owned_fd.h"
#include "mapstore/core/stamp.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Keeps other nights off a store as long as it lives. Its file says that a night is under way, so
/// that the next one knows of a night that was interrupted.
class NightLock {
 public:
  /// Errors: kUnavailable if another night has it; as LockFile.
  static StatusOr<NightLock> Take(const std::string& store);

  /// Notes the begin of a night. Returns that of the first of the nights just before that were
  /// interrupted; nothing if the last one ended.
  /// Errors: kUnavailable if the file cannot be written.
  StatusOr<std::optional<Stamp>> Begin(Stamp begin);

  /// Notes its end.
  void End();

 private:
  NightLock(OwnedFd file, std::string path) : file_(std::move(file)), path_(std::move(path)) {}

  OwnedFd file_;
  std::string path_;
};

/// Versions that were published or refused from the begin of an interrupted night to that of the
/// present one, a line each: they are on no page.
StatusOr<std::vector<std::string>> NameUnreported(MapStore& store, Stamp interrupted, Stamp begin);

}  // namespace shiftmap
