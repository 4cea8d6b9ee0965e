// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "mapstore/core/atomic_file.h"
#include "mapstore/core/owned_fd.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/map/map_version_name.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A snapshot file in a folder of maps.
struct FolderMap {
  std::string map_id;       ///< Area.
  std::string map_version;  ///< As MapVersionName() gives it.
  std::string sha256;       ///< Of the file, in hex.
  std::string path;
  std::int64_t bytes = 0;
  bool enabled = false;  ///< At most one map of an area is.
};

/// What somebody who adds a map knows of it; what is empty may be anything.
struct ExpectedMap {
  std::string map_id;
  std::string map_version;
  std::string sha256;  ///< In hex, of any case.
};

struct MapFolderOptions {
  std::int64_t max_bytes = std::int64_t{2} << 30;  ///< All files may take, > 0. [byte]
  int max_maps = 64;                               ///< Kept at most, > 0.
};

/// Keeps a map from being removed while it lives, also by other processes.
class MapUse {
 public:
  explicit MapUse(OwnedFd fd) : fd_(std::move(fd)) {}

 private:
  OwnedFd fd_;
};

/// The maps that a vehicle carries: snapshot files, each enabled or disabled.
///
/// What is in the folder follows from the names of its files and from the file `enabled`, which is
/// replaced whole. So a power failure leaves the folder as it was before or after a change. Nothing
/// is removed unless somebody asks for it. Layout and names: localizer/maps/README.md.
///
/// Several processes may use one folder: changes wait for each other, and readers for nobody.
/// Errors, of every function: kUnavailable if the disk does not do it. Messages start with
/// `map folder 'PATH': `.
class MapFolder {
 public:
  /// Makes the folder if it is not there. Errors also: kInvalidArgument if something else is there.
  static StatusOr<MapFolder> Open(const std::string& path,
                                  const MapFolderOptions& options = MapFolderOptions());

  /// All maps, by area, then version. Other files are left out.
  StatusOr<std::vector<FolderMap>> List() const;

  /// Errors also: kNotFound.
  StatusOr<FolderMap> Find(const std::string& map_id, const std::string& map_version) const;

  /// The enabled map of an area, or nothing.
  StatusOr<std::optional<FolderMap>> Enabled(const std::string& map_id) const;

  /// Where to write a map that is on its way, in this folder. Files of other keys that nobody has
  /// locked (flock) are removed.
  /// @param key  Tells downloads apart, any bytes.
  StatusOr<std::string> Incoming(const std::string& key) const;

  /// Takes in a snapshot, disabled: checks its hash and loads it as a vehicle would. A file in this
  /// folder is moved, another one copied. Changes no other map.
  /// Errors also: kNotFound without the file; kDataLoss for another hash or a damaged file;
  /// kInvalidArgument, kFailedPrecondition for a file that is no map or another one than expected;
  /// kAlreadyExists if the map is here; kResourceExhausted beyond the bounds.
  StatusOr<FolderMap> Add(const std::string& file, const ExpectedMap& expected = ExpectedMap());

  /// Enables a map, and disables the others of its area; all or nothing. Does nothing to one that
  /// is enabled. Errors also: kNotFound.
  Status Enable(const std::string& map_id, const std::string& map_version);

  /// Removes a map that is disabled. Errors also: kNotFound; kFailedPrecondition if it is enabled
  /// or a process uses it.
  Status Remove(const std::string& map_id, const std::string& map_version);

  /// Errors also: kNotFound if the map is gone.
  StatusOr<MapUse> Use(const FolderMap& map) const;

  const std::string& path() const { return path_; }

 private:
  MapFolder(std::string path, const MapFolderOptions& options)
      : path_(std::move(path)), options_(options) {}

  Status At(const Status& status) const;
  StatusOr<std::vector<std::string>> EnabledFiles() const;
  StatusOr<AtomicFile> Copied(const std::string& file) const;
  StatusOr<FolderMap> Inspect(const std::string& file, const ExpectedMap& expected) const;
  Status CheckRoom(const std::string& file, std::int64_t bytes) const;

  std::string path_;
  MapFolderOptions options_;
};

/// Loads the only map of a snapshot file with the probabilities of now.
/// Errors: as MapStore::LoadAt; kFailedPrecondition for a file of several areas or of none.
StatusOr<MapSnapshot> LoadSnapshotFile(const std::string& path);

}  // namespace shiftmap
