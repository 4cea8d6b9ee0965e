// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/owned_fd.h"
#include "mapstore/map/snapshot_info.h"
#include "mapstore/map_store.h"
#include "mapstore/server/snapshot_signer.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// A snapshot file that is open; it stays in the folder as long.
struct OpenSnapshot {
  SnapshotInfo info;
  OwnedFd fd;
  std::shared_ptr<const void> use;
};

/// The folder of snapshot files, which any web server may hand out: `<sha256>.db`, never changed,
/// and per area `<area>.json` (FileNameOf), which names the newest and those that are kept a while:
///
///     {"area", "version", "content_hash", "ledger_sequence", "created_ns", "sha256", "file",
///      "size_bytes", "signatures": [{"key_sha256", "signature": hex}], "change",
///      "older": [{the same, "superseded_ns"}]}
///
/// One server at a time has a folder. Threads: any.
class SnapshotFolder {
 public:
  /// Takes up what is in the folder, makes it if it is not there, and removes what a server that
  /// was killed left of a file.
  /// @param signers  Whose signatures new snapshots get.
  /// @param keep_s   How long a snapshot stays after another one took its place. [s]
  /// Errors: as MakeFolder; kUnavailable if another server has it.
  static StatusOr<std::unique_ptr<SnapshotFolder>> Open(const std::string& path,
                                                        std::vector<SnapshotSigner> signers,
                                                        double keep_s);

  /// The newest snapshot of an area.
  std::optional<SnapshotInfo> Newest(const std::string& area) const;

  /// The position in the store's audit log that the newest snapshot of an area holds; 0: none.
  std::int64_t Change(const std::string& area) const;

  /// Whether a snapshot has the signatures of all signers.
  bool IsSigned(const SnapshotInfo& snapshot) const;

  /// Makes a snapshot of an area's published version the newest one; the same bytes as before are
  /// the same snapshot.
  /// @param change  As Change() gives it then.
  /// Errors: as MapStore::ExportSnapshot; kUnavailable if the disk does not take it.
  StatusOr<SnapshotInfo> Make(MapStore& store, const std::string& area, std::int64_t change);

  /// @param sha256  Empty: the newest one.
  /// Errors: kNotFound.
  StatusOr<OpenSnapshot> OpenFile(const std::string& area, const std::string& sha256) const;

  /// Removes the files whose time is over and that nobody reads.
  void RemoveOld();

 private:
  struct Kept {
    SnapshotInfo info;
    std::optional<Stamp> superseded;
    std::shared_ptr<const void> use;  // Somebody reads it if there are others.
  };
  struct Area {
    Kept newest;
    std::int64_t change = 0;
    std::vector<Kept> older;  // The oldest first.
  };

  SnapshotFolder(std::string path, std::vector<SnapshotSigner> signers, double keep_s)
      : path_(std::move(path)), signers_(std::move(signers)), keep_s_(keep_s) {}

  std::string FileOf(const std::string& sha256) const { return path_ + "/" + sha256 + ".db"; }
  Status TakeUp();
  void RemoveUnnamed() const;
  Status WriteIndex(const std::string& name, const Area& area) const;

  const std::string path_;
  const std::vector<SnapshotSigner> signers_;
  const double keep_s_;
  OwnedFd lock_;
  mutable std::mutex mutex_;
  std::map<std::string, Area> areas_;
};

}  // namespace shiftmap::server
