// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/map_supply.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "localizer/transfer/serve_client.h"
#include "localizer/transfer/snapshot_fetch.h"

namespace shiftmap::transfer {
namespace {

// Number of maps of the area that the folder keeps in addition to the enabled one.
constexpr std::size_t kOthersKept = 2;

std::optional<FolderMap> WithHash(const std::vector<FolderMap>& maps, const std::string& sha256) {
  const auto found = std::find_if(
      maps.begin(), maps.end(), [&](const FolderMap& map) { return map.sha256 == sha256; });
  return found == maps.end() ? std::nullopt : std::optional<FolderMap>(*found);
}

}  // namespace

Status MapSupply::Fetch(const std::stop_token& stop) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapFolder folder, MapFolder::Open(options_.maps, options_.folder));
  SHIFTMAP_ASSIGN_OR_RETURN(MapClient client, MapClient::Create(options_.server, stop));
  SHIFTMAP_ASSIGN_OR_RETURN(FolderMap map, Brought(&folder, &client));
  next_.reset();
  if (!map.enabled) next_ = std::move(map);
  return OkStatus();
}

StatusOr<FolderMap> MapSupply::Brought(MapFolder* folder, MapClient* client) {
  FetchOptions fetch;
  fetch.area = options_.area;
  fetch.output = options_.spool + "/snapshot.db";
  SHIFTMAP_ASSIGN_OR_RETURN(fetch.keys, SnapshotKeys::Read(options_.keys));
  SHIFTMAP_ASSIGN_OR_RETURN(const SnapshotInfo newest, client->GetSnapshot(options_.area));
  SHIFTMAP_RETURN_IF_ERROR(fetch.keys.Verify(newest));
  SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<FolderMap> maps, folder->List());
  if (const std::optional<FolderMap> here = WithHash(maps, newest.sha256)) return *here;
  fetch.max_bytes_per_s = options_.max_bytes_per_s;
  fetch.progress = [this](double) {
    if (options_.alive) options_.alive();
  };
  SHIFTMAP_ASSIGN_OR_RETURN(const FetchResult fetched, FetchSnapshot(client, fetch));
  const SnapshotInfo& snapshot = fetched.snapshot;
  SHIFTMAP_RETURN_IF_ERROR(DeleteOld(folder));
  StatusOr<FolderMap> added = folder->Add(
      fetch.output, {.map_id = options_.area, .map_version = "", .sha256 = snapshot.sha256});
  if (added.status().code() == StatusCode::kAlreadyExists) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::vector<FolderMap> now, folder->List());
    if (const std::optional<FolderMap> here = WithHash(now, snapshot.sha256)) added = *here;
  }
  SHIFTMAP_RETURN_IF_ERROR(added.status());
  std::error_code ignored;
  std::filesystem::remove(fetch.output, ignored);
  if (options_.inform) {
    options_.inform(fmt::format(
        "map '{}' {} came, {} bytes", added->map_id, added->map_version, snapshot.size_bytes));
  }
  return added;
}

Status MapSupply::Enable() {
  if (!next_) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(MapFolder folder, MapFolder::Open(options_.maps, options_.folder));
  Status taken = NotFound("no service");
  if (!options_.socket.empty()) taken = EnableBetweenShifts(options_.socket, *next_);
  if (taken.code() == StatusCode::kNotFound) {
    // Nobody drives. A shift that was interrupted goes on with the map that is enabled.
    SHIFTMAP_ASSIGN_OR_RETURN(const auto enabled, folder.Enabled(next_->map_id));
    if (enabled && !options_.socket.empty()) return Unavailable("{}", Message(taken));
    taken = folder.Enable(next_->map_id, next_->map_version);
  }
  SHIFTMAP_RETURN_IF_ERROR(taken);
  if (options_.inform) {
    options_.inform(fmt::format("map '{}' {} is enabled", next_->map_id, next_->map_version));
  }
  next_.reset();
  return DeleteOld(&folder);
}

// Leaves room for one more. The enabled one stays.
Status MapSupply::DeleteOld(MapFolder* folder) {
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<FolderMap> maps, folder->List());
  std::erase_if(maps, [&](const FolderMap& map) { return map.map_id != options_.area; });
  std::error_code ignored;
  std::vector<std::pair<std::filesystem::file_time_type, FolderMap>> by_age;
  for (const FolderMap& map : maps) {
    if (!map.enabled) by_age.emplace_back(std::filesystem::last_write_time(map.path, ignored), map);
  }
  std::sort(
      by_age.begin(), by_age.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  for (std::size_t i = 0; i + kOthersKept < by_age.size(); ++i) {
    const FolderMap& old = by_age[i].second;
    if (next_ && old.sha256 == next_->sha256) continue;
    const Status removed = folder->Remove(old.map_id, old.map_version);
    // A process still uses it: the next time, then.
    if (!removed.ok() && removed.code() != StatusCode::kFailedPrecondition) return removed;
  }
  return OkStatus();
}

}  // namespace shiftmap::transfer
