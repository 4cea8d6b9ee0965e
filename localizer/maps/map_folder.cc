// SPDX-License-Identifier: Apache-2.0
#include "localizer/maps/map_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <system_error>
#include <tuple>

#include "localizer/maps/map_file_name.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/input_file.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

constexpr const char* kEnabled = "enabled";
constexpr std::string_view kIncoming = "incoming-";
constexpr std::size_t kIncomingDigits = 16;
constexpr std::streamsize kCopyBytes = 1 << 16;

Status DiskError(const char* action, const std::string& name) {
  return MakeStatus(errno == ENOENT ? StatusCode::kNotFound : StatusCode::kUnavailable,
                    "cannot {} '{}': {}",
                    action,
                    name,
                    std::strerror(errno));
}

std::string NameOf(const std::string& path) { return fs::path(path).filename().string(); }

// Whether a file, if it is there, was removed or is locked by somebody.
Status RemoveUnlessLocked(const std::string& path) {
  const OwnedFd fd(open(path.c_str(), O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (fd.get() < 0) return DiskError("open", NameOf(path));
  if (flock(fd.get(), LOCK_EX | LOCK_NB) != 0) {
    return FailedPrecondition("'{}' is in use", NameOf(path));
  }
  if (unlink(path.c_str()) != 0) return DiskError("remove", NameOf(path));
  return OkStatus();
}

// All regular files with their sizes.
StatusOr<std::vector<std::pair<std::string, std::int64_t>>> FilesOf(const std::string& folder) {
  std::vector<std::pair<std::string, std::int64_t>> files;
  std::error_code error;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error)) {
    std::error_code unread;
    const bool regular = at->is_regular_file(unread);
    const auto bytes = regular ? at->file_size(unread) : 0;
    // What is gone by now was another process's.
    if (regular && !unread) {
      files.emplace_back(at->path().filename().string(), static_cast<std::int64_t>(bytes));
    }
  }
  if (error) return Unavailable("cannot list it: {}", error.message());
  return files;
}

}  // namespace

StatusOr<MapSnapshot> LoadSnapshotFile(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<AreaSummary> areas, store.Areas());
  if (areas.size() != 1) {
    return FailedPrecondition("snapshot '{}': holds {} areas, expected one", path, areas.size());
  }
  return store.LoadAt(areas.front().area);
}

StatusOr<MapFolder> MapFolder::Open(const std::string& path, const MapFolderOptions& options) {
  MapFolder folder(path, options);
  if (const Status status = MakeFolder(path); !status.ok()) return folder.At(status);
  return folder;
}

Status MapFolder::At(const Status& status) const {
  return Annotate(status, "map folder '{}'", path_);
}

StatusOr<std::vector<std::string>> MapFolder::EnabledFiles() const {
  const std::string path = path_ + "/" + kEnabled;
  const auto text = ReadInputFile("list", path);
  if (text.status().code() == StatusCode::kNotFound) return std::vector<std::string>();
  if (!text.ok()) return text.status();
  std::vector<std::string> files;
  std::string_view left = *text;
  for (std::string_view line; TakeLine(&left, &line);) files.emplace_back(line);
  return files;
}

StatusOr<std::vector<FolderMap>> MapFolder::List() const {
  // The names first: a map that is removed in between was not enabled.
  const auto files = FilesOf(path_);
  if (!files.ok()) return At(files.status());
  const auto enabled = EnabledFiles();
  if (!enabled.ok()) return At(enabled.status());
  std::vector<FolderMap> maps;
  for (const auto& [name, bytes] : *files) {
    std::optional<FolderMap> map = ParseMapFileName(name);
    if (!map) continue;
    map->path = path_ + "/" + name;
    map->bytes = bytes;
    map->enabled = std::find(enabled->begin(), enabled->end(), name) != enabled->end();
    maps.push_back(*std::move(map));
  }
  std::sort(maps.begin(), maps.end(), [](const FolderMap& a, const FolderMap& b) {
    return std::tie(a.map_id, a.map_version) < std::tie(b.map_id, b.map_version);
  });
  return maps;
}

StatusOr<FolderMap> MapFolder::Find(const std::string& map_id,
                                    const std::string& map_version) const {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<FolderMap> maps, List());
  for (FolderMap& map : maps) {
    if (map.map_id == map_id && map.map_version == map_version) return std::move(map);
  }
  return At(NotFound("no map '{}' version '{}'", map_id, map_version));
}

StatusOr<std::optional<FolderMap>> MapFolder::Enabled(const std::string& map_id) const {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<FolderMap> maps, List());
  for (FolderMap& map : maps) {
    if (map.enabled && map.map_id == map_id) return std::optional<FolderMap>(std::move(map));
  }
  return std::optional<FolderMap>();
}

StatusOr<std::string> MapFolder::Incoming(const std::string& key) const {
  Sha256 hash;
  hash.Update(key);
  const std::string name = std::string(kIncoming) + hash.HexDigest().substr(0, kIncomingDigits);
  const auto files = FilesOf(path_);
  if (!files.ok()) return At(files.status());
  for (const auto& [other, bytes] : *files) {
    // One that cannot be removed only takes room.
    if (other.starts_with(kIncoming) && other != name) {
      (void)RemoveUnlessLocked(path_ + "/" + other);
    }
  }
  return path_ + "/" + name;
}

// Reads the map before it has its name: a file that has it is good.
StatusOr<FolderMap> MapFolder::Inspect(const std::string& file, const ExpectedMap& expected) const {
  FolderMap map;
  SHIFTMAP_ASSIGN_OR_RETURN(map.sha256, HashFile(file));
  std::string wanted = expected.sha256;
  std::transform(wanted.begin(), wanted.end(), wanted.begin(), [](char letter) {
    return letter >= 'A' && letter <= 'F' ? static_cast<char>(letter - 'A' + 'a') : letter;
  });
  if (!wanted.empty() && wanted != map.sha256) {
    return DataLoss("file '{}': hash {}, expected {}", file, map.sha256, wanted);
  }
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot snapshot, LoadSnapshotFile(file));
  map.map_id = snapshot.area();
  map.map_version = MapVersionName(snapshot.version(), snapshot.content_hash(), map.sha256);
  const bool same = (expected.map_id.empty() || expected.map_id == map.map_id) &&
                    (expected.map_version.empty() || expected.map_version == map.map_version);
  if (!same) {
    return FailedPrecondition("file '{}': holds map '{}' version '{}', expected '{}' version '{}'",
                              file,
                              map.map_id,
                              map.map_version,
                              expected.map_id,
                              expected.map_version);
  }
  return map;
}

Status MapFolder::CheckRoom(const std::string& file, std::int64_t bytes) const {
  SHIFTMAP_ASSIGN_OR_RETURN(const auto files, FilesOf(path_));
  std::int64_t held = 0;
  int maps = 0;
  for (const auto& [name, size] : files) {
    if (path_ + "/" + name != file) held += size;
    maps += ParseMapFileName(name).has_value();
  }
  if (held + bytes > options_.max_bytes) {
    return MakeStatus(StatusCode::kResourceExhausted,
                      "{} bytes, and {} more, expected at most {}: remove maps",
                      held,
                      bytes,
                      options_.max_bytes);
  }
  if (maps < options_.max_maps) return OkStatus();
  return MakeStatus(StatusCode::kResourceExhausted,
                    "{} maps, expected at most {} with another: remove maps",
                    maps,
                    options_.max_maps);
}

// A copy is locked as long as it is open, and its name is free for the next copy afterwards.
StatusOr<AtomicFile> MapFolder::Copied(const std::string& file) const {
  SHIFTMAP_ASSIGN_OR_RETURN(std::ifstream source, OpenInputFile(file));
  SHIFTMAP_ASSIGN_OR_RETURN(AtomicFile copy, AtomicFile::Create(path_ + "/copy"));
  std::vector<char> bytes(kCopyBytes);
  while (source.read(bytes.data(), kCopyBytes) || source.gcount() > 0) {
    const auto count = static_cast<std::size_t>(source.gcount());
    SHIFTMAP_RETURN_IF_ERROR(copy.Append(std::string_view(bytes.data(), count)));
  }
  if (source.bad()) return Unavailable("cannot read '{}'", file);
  return copy;
}

StatusOr<FolderMap> MapFolder::Add(const std::string& file, const ExpectedMap& expected) {
  const auto add = [&]() -> StatusOr<FolderMap> {
    std::error_code error;
    const auto size = fs::file_size(file, error);
    if (error) return NotFound("cannot read '{}': {}", file, error.message());
    const auto bytes = static_cast<std::int64_t>(size);
    SHIFTMAP_RETURN_IF_ERROR(CheckRoom(file, bytes));
    const bool here = fs::equivalent(fs::absolute(file).parent_path(), path_, error);
    std::optional<AtomicFile> copy;
    if (!here) {
      SHIFTMAP_ASSIGN_OR_RETURN(copy, Copied(file));
    }
    const std::string source = copy ? copy->temporary() : file;
    SHIFTMAP_ASSIGN_OR_RETURN(FolderMap map, Inspect(source, expected));
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string name, MapFileName(map));
    SHIFTMAP_ASSIGN_OR_RETURN(const FolderLock lock, FolderLock::Take(path_));
    if (Find(map.map_id, map.map_version).ok()) {
      return MakeStatus(StatusCode::kAlreadyExists,
                        "map '{}' version '{}' is there already",
                        map.map_id,
                        map.map_version);
    }
    // Others may have added maps meanwhile.
    SHIFTMAP_RETURN_IF_ERROR(CheckRoom(source, bytes));
    map.path = path_ + "/" + name;
    map.bytes = bytes;
    SHIFTMAP_RETURN_IF_ERROR(copy ? copy->CommitAs(map.path) : SyncAndRename(source, map.path));
    return map;
  };
  auto added = add();
  return added.ok() ? std::move(added) : At(added.status());
}

Status MapFolder::Enable(const std::string& map_id, const std::string& map_version) {
  const auto lock = FolderLock::Take(path_);
  if (!lock.ok()) return At(lock.status());
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<FolderMap> maps, List());
  std::string text;
  bool found = false;
  for (const FolderMap& map : maps) {
    const bool chosen = map.map_id == map_id && map.map_version == map_version;
    if (chosen && map.enabled) return OkStatus();
    found = found || chosen;
    if (chosen || (map.enabled && map.map_id != map_id)) text += NameOf(map.path) + "\n";
  }
  if (!found) return At(NotFound("no map '{}' version '{}'", map_id, map_version));
  return At(WriteFileAtomically(path_ + "/" + kEnabled, text));
}

Status MapFolder::Remove(const std::string& map_id, const std::string& map_version) {
  const auto lock = FolderLock::Take(path_);
  if (!lock.ok()) return At(lock.status());
  SHIFTMAP_ASSIGN_OR_RETURN(const FolderMap map, Find(map_id, map_version));
  if (map.enabled) {
    return At(FailedPrecondition(
        "map '{}' version '{}' is enabled, expected a disabled one", map_id, map_version));
  }
  const Status removed = RemoveUnlessLocked(map.path);
  return At(removed.ok() ? SyncFolderOf(map.path) : removed);
}

StatusOr<MapUse> MapFolder::Use(const FolderMap& map) const {
  OwnedFd fd(open(map.path.c_str(), O_RDONLY | O_NOFOLLOW | O_CLOEXEC));
  if (fd.get() < 0) return At(DiskError("open", NameOf(map.path)));
  struct stat info {};
  // Who removes a map holds it alone, and leaves it without a name.
  const bool mine = flock(fd.get(), LOCK_SH | LOCK_NB) == 0;
  if (!mine || fstat(fd.get(), &info) != 0 || info.st_nlink == 0) {
    return At(NotFound("map '{}' version '{}' is being removed", map.map_id, map.map_version));
  }
  return MapUse(std::move(fd));
}

}  // namespace shiftmap
