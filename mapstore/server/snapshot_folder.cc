// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/snapshot_folder.h"

#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <set>
#include <utility>

#include "mapstore/codec/snapshot_json.h"
#include "mapstore/core/atomic_file.h"
#include "mapstore/core/clock.h"
#include "mapstore/core/file_name.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/input_file.h"
#include "mapstore/core/lock_file.h"
#include "mapstore/map/shift_report_check.h"

namespace shiftmap::server {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::size_t kMaxIndexBytes = std::size_t{16} << 20;
constexpr const char* kUnfinished = "new-";

std::int64_t SizeOf(const std::string& path) {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  return error ? -1 : static_cast<std::int64_t>(size);
}

}  // namespace

StatusOr<std::unique_ptr<SnapshotFolder>> SnapshotFolder::Open(const std::string& path,
                                                               std::vector<SnapshotSigner> signers,
                                                               double keep_s) {
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(path));
  std::unique_ptr<SnapshotFolder> folder(new SnapshotFolder(path, std::move(signers), keep_s));
  // Not on the folder itself, which whoever makes a store in it locks for a moment.
  SHIFTMAP_ASSIGN_OR_RETURN(std::optional<OwnedFd> lock, LockFile(path + "/.lock"));
  if (!lock) return Unavailable("folder '{}': another server has it", path);
  folder->lock_ = *std::move(lock);
  SHIFTMAP_RETURN_IF_ERROR(folder->TakeUp());
  return folder;
}

Status SnapshotFolder::TakeUp() {
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(path_, error)) {
    if (entry.path().extension() != ".json") continue;
    StatusOr<std::string> text = ReadInputFile("index", entry.path(), kMaxIndexBytes);
    if (!text.ok()) continue;
    // What does not read is made anew.
    try {
      const Json json = Json::parse(*text);
      Area area{{SnapshotFromJson(json), std::nullopt, std::make_shared<int>()},
                json.at("change").get<std::int64_t>(),
                {}};
      for (const Json& old : json.at("older")) {
        area.older.push_back({SnapshotFromJson(old),
                              StampFromNanoseconds(old.at("superseded_ns").get<std::int64_t>()),
                              std::make_shared<int>()});
      }
      const SnapshotInfo& newest = area.newest.info;
      const bool there =
          IsSha256Hex(newest.sha256) && SizeOf(FileOf(newest.sha256)) == newest.size_bytes;
      if (there) areas_.emplace(newest.area, std::move(area));
    } catch (const Json::exception&) {
      continue;
    }
  }
  RemoveUnnamed();
  return error ? Unavailable("folder '{}': cannot be read: {}", path_, error.message())
               : OkStatus();
}

void SnapshotFolder::RemoveUnnamed() const {
  std::set<std::string> named;
  for (const auto& [name, area] : areas_) {
    named.insert(area.newest.info.sha256);
    for (const Kept& old : area.older) named.insert(old.info.sha256);
  }
  std::error_code error;
  for (const auto& entry : std::filesystem::directory_iterator(path_, error)) {
    const std::string stem = entry.path().stem();
    const std::string file = entry.path().filename();
    const bool ours = entry.path().extension() == ".db" && IsSha256Hex(stem);
    const bool unnamed = ours && !named.contains(stem);
    std::error_code ignored;
    if (unnamed || file.starts_with(kUnfinished)) std::filesystem::remove(entry.path(), ignored);
  }
}

std::optional<SnapshotInfo> SnapshotFolder::Newest(const std::string& area) const {
  const std::lock_guard lock(mutex_);
  const auto found = areas_.find(area);
  if (found == areas_.end()) return std::nullopt;
  return found->second.newest.info;
}

std::int64_t SnapshotFolder::Change(const std::string& area) const {
  const std::lock_guard lock(mutex_);
  const auto found = areas_.find(area);
  return found == areas_.end() ? 0 : found->second.change;
}

bool SnapshotFolder::IsSigned(const SnapshotInfo& snapshot) const {
  return std::all_of(signers_.begin(), signers_.end(), [&](const SnapshotSigner& signer) {
    return std::any_of(
        snapshot.signatures.begin(), snapshot.signatures.end(), [&](const auto& signature) {
          return signature.key_sha256 == signer.key_sha256();
        });
  });
}

Status SnapshotFolder::WriteIndex(const std::string& name, const Area& area) const {
  Json json = SnapshotJson(area.newest.info);
  json["change"] = area.change;
  json["older"] = Json::array();
  for (const Kept& old : area.older) {
    Json entry = SnapshotJson(old.info);
    entry["superseded_ns"] = ToNanoseconds(*old.superseded);
    json["older"].push_back(std::move(entry));
  }
  return WriteFileAtomically(path_ + "/" + FileNameOf(name) + ".json",
                             json.dump(2, ' ', false, Json::error_handler_t::replace) + "\n");
}

StatusOr<SnapshotInfo> SnapshotFolder::Make(MapStore& store,
                                            const std::string& area,
                                            std::int64_t change) {
  const std::string unfinished = path_ + "/" + kUnfinished + FileNameOf(area);
  SHIFTMAP_ASSIGN_OR_RETURN(const ExportedSnapshot exported,
                            store.ExportWithIdentity(area, unfinished));
  SnapshotInfo info{area,
                    exported.version,
                    exported.content_hash,
                    exported.ledger_position,
                    SystemNow(),
                    exported.sha256,
                    SizeOf(unfinished),
                    {}};
  for (const SnapshotSigner& signer : signers_) info.signatures.push_back(signer.Sign(info));
  SHIFTMAP_RETURN_IF_ERROR(SyncAndRename(unfinished, FileOf(info.sha256)));
  const std::lock_guard lock(mutex_);
  const auto found = areas_.find(area);
  Area next;
  if (found != areas_.end()) {
    next = found->second;
    // What an older one is the newest again is not old any more.
    std::erase_if(next.older, [&](const Kept& old) { return old.info.sha256 == info.sha256; });
    if (next.newest.info.sha256 != info.sha256) {
      next.newest.superseded = info.created;
      next.older.push_back(next.newest);
    }
  }
  next.newest = {info, std::nullopt, std::make_shared<int>()};
  next.change = change;
  SHIFTMAP_RETURN_IF_ERROR(WriteIndex(area, next));
  areas_[area] = std::move(next);
  return info;
}

StatusOr<OpenSnapshot> SnapshotFolder::OpenFile(const std::string& area,
                                                const std::string& sha256) const {
  const std::lock_guard lock(mutex_);
  const auto found = areas_.find(area);
  if (found == areas_.end()) return NotFound("area '{}': no snapshot", area);
  const Kept* kept = &found->second.newest;
  if (!sha256.empty() && kept->info.sha256 != sha256) {
    const auto& older = found->second.older;
    const auto old = std::find_if(
        older.begin(), older.end(), [&](const Kept& each) { return each.info.sha256 == sha256; });
    if (old == older.end()) return NotFound("area '{}': no snapshot {}", area, sha256);
    kept = &*old;
  }
  OwnedFd fd(open(FileOf(kept->info.sha256).c_str(), O_RDONLY | O_CLOEXEC));
  if (fd.get() < 0) return Unavailable("snapshot {}: cannot be opened", kept->info.sha256);
  return OpenSnapshot{kept->info, std::move(fd), kept->use};
}

void SnapshotFolder::RemoveOld() {
  const Stamp before = SystemNow() - FromSeconds(keep_s_);
  const std::lock_guard lock(mutex_);
  std::set<std::string> current;
  for (const auto& [name, area] : areas_) current.insert(area.newest.info.sha256);
  for (auto& [name, area] : areas_) {
    Area next = area;
    std::vector<std::string> over;
    for (const Kept& old : area.older) {
      // Held by the list, by its copy, and by nobody else.
      if (*old.superseded < before && old.use.use_count() == 2) over.push_back(old.info.sha256);
    }
    if (over.empty()) continue;
    std::erase_if(next.older, [&](const Kept& old) {
      return std::find(over.begin(), over.end(), old.info.sha256) != over.end();
    });
    // The index first: a file that is not named is removed at the next start.
    if (!WriteIndex(name, next).ok()) continue;
    area = std::move(next);
    for (const std::string& sha256 : over) {
      std::error_code ignored;
      if (!current.contains(sha256)) std::filesystem::remove(FileOf(sha256), ignored);
    }
  }
}

}  // namespace shiftmap::server
