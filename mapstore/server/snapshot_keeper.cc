// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/snapshot_keeper.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/core/clock.h"

namespace shiftmap::server {
namespace {

// After a snapshot that could not be made.
constexpr std::chrono::seconds kPause{10};

}  // namespace

SnapshotKeeper::SnapshotKeeper(MapStore store,
                               const SnapshotKeeperOptions& options,
                               SnapshotFolder* folder,
                               SnapshotFeed* feed,
                               JsonLog* log)
    : store_(std::move(store)), options_(options), folder_(folder), feed_(feed), log_(log) {
  Look();
  thread_ = std::thread([this] { Work(); });
}

SnapshotKeeper::~SnapshotKeeper() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  stopped_changed_.notify_one();
  thread_.join();
}

std::vector<AreaState> SnapshotKeeper::areas() const {
  const std::lock_guard lock(mutex_);
  return areas_;
}

SnapshotKeeper::Clock::duration SnapshotKeeper::idle() const {
  const std::lock_guard lock(mutex_);
  return Clock::now() - looked_;
}

void SnapshotKeeper::Work() {
  std::unique_lock lock(mutex_);
  while (!stopped_changed_.wait_for(
      lock, std::chrono::duration<double>(options_.poll_s), [this] { return stopped_; })) {
    lock.unlock();
    Look();
    lock.lock();
  }
}

void SnapshotKeeper::Look() {
  if (const Status read = ReadChanges(); !read.ok()) {
    log_->Write(JsonLog::Level::kWarning, "store unreadable", {{"message", Message(read)}});
  }
  MakeWhatIsDue();
  folder_->RemoveOld();
  const std::lock_guard lock(mutex_);
  looked_ = Clock::now();
}

Status SnapshotKeeper::ReadChanges() {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::int64_t data_version, store_.DataVersion());
  if (data_version_ == data_version) return OkStatus();
  SHIFTMAP_ASSIGN_OR_RETURN(StoreChanges changes, store_.ChangesSince(position_));
  // What a restored backup does not tell of is to be made anew.
  if (changes.position < position_) watched_.clear();
  data_version_ = data_version;
  position_ = changes.position;
  for (AreaState& area : changes.areas) {
    Watched& watched = watched_[area.area];
    if (area.last_change > 0) watched.last_change = area.last_change;
  }
  const std::lock_guard lock(mutex_);
  areas_ = std::move(changes.areas);
  return OkStatus();
}

bool SnapshotKeeper::IsDue(const AreaState& area, const Watched& watched) const {
  if (!area.published || Clock::now() < watched.not_before) return false;
  const std::optional<SnapshotInfo> newest = folder_->Newest(area.area);
  if (!newest || newest->version != *area.published) return true;
  // Made before the site had this key: vehicles may ask for its signature.
  if (!folder_->IsSigned(*newest)) return true;
  const bool changed = folder_->Change(area.area) != watched.last_change;
  const Stamp now = SystemNow();
  // A clock that was put back must not stop snapshots.
  const bool waited =
      now < newest->created || now - newest->created >= FromSeconds(options_.interval_s);
  return changed && waited;
}

void SnapshotKeeper::MakeWhatIsDue() {
  for (const AreaState& area : areas()) {
    Watched& watched = watched_[area.area];
    if (!IsDue(area, watched)) continue;
    const StatusOr<SnapshotInfo> made = folder_->Make(store_, area.area, watched.last_change);
    if (!made.ok()) {
      watched.not_before = Clock::now() + kPause;
      log_->Write(JsonLog::Level::kError,
                  "snapshot failed",
                  {{"area", area.area}, {"message", Message(made.status())}});
      continue;
    }
    log_->Write(JsonLog::Level::kInfo,
                "snapshot",
                {{"area", made->area},
                 {"version", made->version.value()},
                 {"ledger_sequence", made->ledger_sequence.value()},
                 {"sha256", made->sha256},
                 {"size_bytes", made->size_bytes}});
    feed_->Tell(*made);
  }
}

}  // namespace shiftmap::server
