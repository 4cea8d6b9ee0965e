// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/snapshot_fetch.h"

#include <filesystem>
#include <optional>
#include <system_error>

#include "localizer/transfer/partial_file.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"

namespace shiftmap::transfer {
namespace {

// A snapshot on the disk may be wrong once: a power failure took bytes of the part.
constexpr int kMaxWrongFiles = 2;

class Fetch {
 public:
  Fetch(MapClient* client, const FetchOptions& options)
      : client_(*client),
        options_(options),
        limit_(options.max_bytes_per_s),
        backoff_(options.backoff, RandomSeed()) {}

  StatusOr<FetchResult> Run() {
    for (;;) {
      const Status status = Try();
      if (status.ok()) break;
      // What was gone meanwhile is fetched anew, as its successor.
      if (status.code() == StatusCode::kNotFound && gone_) continue;
      if (!backoff_.Again(status, client_.stop())) return status;
    }
    result_.retries = backoff_.retries();
    return result_;
  }

 private:
  Status Try() {
    gone_ = false;
    SHIFTMAP_ASSIGN_OR_RETURN(result_.snapshot, client_.GetSnapshot(options_.area));
    SHIFTMAP_RETURN_IF_ERROR(options_.keys.Verify(result_.snapshot));
    const StatusOr<std::string> placed = HashFile(options_.output);
    result_.not_changed = placed.ok() && *placed == result_.snapshot.sha256;
    if (result_.not_changed || options_.dry_run) return OkStatus();
    if (!part_) {
      SHIFTMAP_ASSIGN_OR_RETURN(part_, PartialFile::Open(options_.output));
      result_.resumed_bytes = Continues() ? part_->size_bytes() : 0;
    }
    if (!Continues()) SHIFTMAP_RETURN_IF_ERROR(part_->Begin(result_.snapshot));
    SHIFTMAP_RETURN_IF_ERROR(CheckRoom());
    SHIFTMAP_RETURN_IF_ERROR(Receive());
    return Finish();
  }

  // Whether the part is of the snapshot that is wanted, or of one of the same map.
  bool Continues() const {
    const std::optional<SnapshotInfo>& of = part_->of();
    const SnapshotInfo& newest = result_.snapshot;
    return of && of->area == newest.area && of->version == newest.version &&
           of->content_hash == newest.content_hash &&
           (of->sha256 == newest.sha256 || part_->size_bytes() > 0);
  }

  Status CheckRoom() const {
    std::error_code unknown;
    const auto folder = std::filesystem::absolute(options_.output, unknown).parent_path();
    const std::filesystem::space_info disk = std::filesystem::space(folder, unknown);
    const std::int64_t left = part_->of()->size_bytes - part_->size_bytes();
    if (unknown || static_cast<std::int64_t>(disk.available) >= left) return OkStatus();
    return Unavailable("snapshot '{}': {} bytes are left of the disk, expected {}",
                       options_.output,
                       disk.available,
                       left);
  }

  Status Receive() {
    const SnapshotInfo of = *part_->of();
    if (part_->size_bytes() == of.size_bytes) return OkStatus();
    const Status status =
        client_.FetchSnapshot(of, part_->size_bytes(), [&](std::string_view bytes) {
          if (!limit_.Take(bytes.size(), client_.stop())) {
            return MakeStatus(StatusCode::kCancelled, "stopped");
          }
          backoff_.Progress();
          result_.received_bytes += static_cast<std::int64_t>(bytes.size());
          const Status taken = part_->Append(bytes);
          if (options_.progress && of.size_bytes > 0) {
            options_.progress(static_cast<double>(part_->size_bytes()) /
                              static_cast<double>(of.size_bytes));
          }
          return taken;
        });
    gone_ = status.code() == StatusCode::kNotFound && of.sha256 != result_.snapshot.sha256;
    if (gone_) SHIFTMAP_RETURN_IF_ERROR(part_->Begin(result_.snapshot));
    SHIFTMAP_RETURN_IF_ERROR(status);
    if (part_->size_bytes() == of.size_bytes) return OkStatus();
    return Unavailable(
        "snapshot '{}': {} of {} bytes came", options_.output, part_->size_bytes(), of.size_bytes);
  }

  Status Finish() {
    const SnapshotInfo of = *part_->of();
    SHIFTMAP_ASSIGN_OR_RETURN(const std::string sha256, HashFile(part_->part()));
    if (sha256 != of.sha256) {
      SHIFTMAP_RETURN_IF_ERROR(part_->Begin(result_.snapshot));
      const std::string message = fmt::format(
          "snapshot '{}': its hash is {}, expected {}", options_.output, sha256, of.sha256);
      return ++wrong_files_ < kMaxWrongFiles ? Unavailable("{}", message) : DataLoss("{}", message);
    }
    Status checked = options_.keys.Verify(of);
    if (checked.ok()) checked = CheckSnapshotFile(part_->part(), of);
    if (!checked.ok()) {
      part_->Remove();
      return checked;
    }
    SHIFTMAP_RETURN_IF_ERROR(part_->Place());
    result_.snapshot = of;
    return OkStatus();
  }

  MapClient& client_;
  const FetchOptions& options_;
  RateLimit limit_;
  Backoff backoff_;
  std::optional<PartialFile> part_;
  FetchResult result_;
  bool gone_ = false;  // The snapshot that was begun is not there any more.
  int wrong_files_ = 0;
};

}  // namespace

Status CheckSnapshotFile(const std::string& path, const SnapshotInfo& snapshot) {
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, MapStore::Open(path, MapStore::Access::kReadOnly));
  SHIFTMAP_ASSIGN_OR_RETURN(const MapSnapshot map, store.LoadAt(snapshot.area));
  if (map.version() == snapshot.version && map.content_hash() == snapshot.content_hash) {
    return OkStatus();
  }
  return DataLoss("snapshot {}: it holds version {} with content {}, expected {} with {}",
                  snapshot.sha256,
                  map.version().value(),
                  map.content_hash(),
                  snapshot.version.value(),
                  snapshot.content_hash);
}

StatusOr<FetchResult> FetchSnapshot(MapClient* client, const FetchOptions& options) {
  return Fetch(client, options).Run();
}

}  // namespace shiftmap::transfer
