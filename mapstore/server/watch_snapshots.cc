// SPDX-License-Identifier: Apache-2.0
//
// The call that stays open: many vehicles wait in it, so it has no thread.
#include <chrono>
#include <mutex>
#include <optional>

#include "mapstore/server/codec/map_service_codec.h"
#include "mapstore/server/map_service.h"

namespace shiftmap::server {

/// One client that watches an area; deletes itself when the call is over.
class MapService::Watch final : public grpc::ServerWriteReactor<proto::Snapshot> {
 public:
  Watch(MapService* service, grpc::CallbackServerContext* context)
      : service_(service), context_(context) {}

  /// Refuses the call, or goes on until the client goes or the server ends.
  void Begin(const std::string& area) {
    const Status admitted = Admit(area);
    if (!admitted.ok()) {
      End(admitted);
      return;
    }
    joined_ = service_->parts_.feed->Join(
        area, [this](const SnapshotInfo& snapshot) { Offer(snapshot); });
    if (const auto newest = service_->parts_.snapshots->Newest(area)) Offer(*newest);
  }

  void End(const Status& status) {
    {
      const std::lock_guard lock(mutex_);
      if (finished_) return;
      finished_ = true;
      status_ = status;
    }
    // This object may be gone once it returns.
    Finish(ToGrpc(status));
  }

  void OnWriteDone(bool ok) override {
    if (!ok) {
      End(MakeStatus(StatusCode::kCancelled, "the client went"));
      return;
    }
    const std::lock_guard lock(mutex_);
    writing_ = false;
    WriteNext();
  }

  void OnCancel() override { End(MakeStatus(StatusCode::kCancelled, "the client went")); }

  void OnDone() override {
    if (joined_) service_->parts_.feed->Leave(*joined_);
    {
      const std::lock_guard lock(service_->mutex_);
      service_->watches_.erase(this);
    }
    const double open_s = std::chrono::duration<double>(Clock::now() - begin_).count();
    service_->Note(*context_, Call::kWatchSnapshots, client_, status_, open_s);
    delete this;
  }

 private:
  using Clock = std::chrono::steady_clock;

  Status Admit(const std::string& area) {
    Caller caller;
    const Status admitted = service_->Admit(*context_, Call::kWatchSnapshots, &caller);
    client_ = caller.name;
    SHIFTMAP_RETURN_IF_ERROR(admitted);
    SHIFTMAP_ASSIGN_OR_RETURN(slot_, service_->parts_.watches->Take(caller.limit_key));
    if (area.empty()) return InvalidArgument("area: expected a name");
    return OkStatus();
  }

  void Offer(const SnapshotInfo& snapshot) {
    // The certificate may have been revoked since the call began.
    if (const Status known = service_->parts_.gate->Identify(PeerOf(*context_)).status();
        !known.ok()) {
      End(known);
      return;
    }
    const std::lock_guard lock(mutex_);
    if (last_sha256_ == snapshot.sha256) return;
    next_ = snapshot;
    WriteNext();
  }

  // With the mutex held.
  void WriteNext() {
    if (finished_ || writing_ || !next_) return;
    message_.Clear();
    ToProto(*next_, &message_);
    last_sha256_ = next_->sha256;
    next_.reset();
    writing_ = true;
    StartWrite(&message_);
  }

  MapService* const service_;
  grpc::CallbackServerContext* const context_;
  const Clock::time_point begin_ = Clock::now();
  std::string client_;
  Slots::Slot slot_;
  std::optional<std::int64_t> joined_;
  std::mutex mutex_;
  bool finished_ = false;
  bool writing_ = false;
  Status status_;
  std::optional<SnapshotInfo> next_;
  std::string last_sha256_;
  proto::Snapshot message_;
};

grpc::ServerWriteReactor<proto::Snapshot>* MapService::WatchSnapshots(
    grpc::CallbackServerContext* context, const proto::WatchSnapshotsRequest* request) {
  auto* const watch = new Watch(this, context);
  bool ended = false;
  {
    const std::lock_guard lock(mutex_);
    watches_.insert(watch);
    ended = ended_;
  }
  if (ended) {
    watch->End(Unavailable("the server is stopping"));
  } else {
    watch->Begin(request->area());
  }
  return watch;
}

void MapService::EndWatches() {
  const std::lock_guard lock(mutex_);
  ended_ = true;
  for (Watch* const watch : watches_) watch->End(Unavailable("the server is stopping"));
}

}  // namespace shiftmap::server
