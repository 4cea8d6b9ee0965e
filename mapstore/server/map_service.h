// SPDX-License-Identifier: Apache-2.0
//
// The calls of proto/map_server.proto. Inside server/ only: it is for generated types.
#pragma once

#include <functional>
#include <mutex>
#include <set>
#include <string>

#include "mapstore/server/access_gate.h"
#include "mapstore/server/json_log.h"
#include "mapstore/server/limits.h"
#include "mapstore/server/metrics.h"
#include "mapstore/server/snapshot_feed.h"
#include "mapstore/server/snapshot_folder.h"
#include "mapstore/server/store_readers.h"
#include "mapstore/server/store_writer.h"
#include "mapstore/server/upload_spool.h"
#include "proto/map_server.grpc.pb.h"

namespace shiftmap::server {

/// What the calls work on; all must outlive the service.
struct ServiceParts {
  StoreReaders* readers = nullptr;
  StoreWriter* writer = nullptr;
  SnapshotFolder* snapshots = nullptr;
  SnapshotFeed* feed = nullptr;
  UploadSpool* uploads = nullptr;  ///< Null: no logs are taken.
  AccessGate* gate = nullptr;
  Slots* transfers = nullptr;  ///< Downloads and uploads.
  Slots* watches = nullptr;
  Metrics* metrics = nullptr;
  JsonLog* log = nullptr;
};

/// One thread a call, but for WatchSnapshots, of which there may be many for a long time.
class MapService final
    : public proto::MapServer::WithCallbackMethod_WatchSnapshots<proto::MapServer::Service> {
 public:
  explicit MapService(const ServiceParts& parts) : parts_(parts) {}

  /// Ends all WatchSnapshots, and those to come.
  void EndWatches();

  grpc::Status ListAreas(grpc::ServerContext* context,
                         const proto::ListAreasRequest* request,
                         proto::ListAreasResponse* response) override;
  grpc::Status ListVersions(grpc::ServerContext* context,
                            const proto::ListVersionsRequest* request,
                            proto::ListVersionsResponse* response) override;
  grpc::Status GetSnapshot(grpc::ServerContext* context,
                           const proto::GetSnapshotRequest* request,
                           proto::Snapshot* response) override;
  grpc::Status FetchSnapshot(grpc::ServerContext* context,
                             const proto::FetchSnapshotRequest* request,
                             grpc::ServerWriter<proto::FetchSnapshotResponse>* writer) override;
  grpc::Status GetModeProbabilities(grpc::ServerContext* context,
                                    const proto::GetModeProbabilitiesRequest* request,
                                    proto::GetModeProbabilitiesResponse* response) override;
  grpc::Status SubmitReport(grpc::ServerContext* context,
                            const proto::SubmitReportRequest* request,
                            proto::SubmitReportResponse* response) override;
  grpc::Status GetUpload(grpc::ServerContext* context,
                         const proto::GetUploadRequest* request,
                         proto::UploadState* response) override;
  grpc::Status UploadLog(grpc::ServerContext* context,
                         grpc::ServerReader<proto::UploadLogRequest>* reader,
                         proto::UploadState* response) override;
  grpc::ServerWriteReactor<proto::Snapshot>* WatchSnapshots(
      grpc::CallbackServerContext* context, const proto::WatchSnapshotsRequest* request) override;

 private:
  class Watch;
  using Body = std::function<Status(const Caller&)>;

  /// @param caller  Gets who it is, if that is known, also when he may not.
  Status Admit(const grpc::ServerContextBase& context, Call call, Caller* caller);

  /// Runs a call: who it is, whether he may, and afterwards counts and logs it.
  grpc::Status Serve(const grpc::ServerContextBase& context, Call call, const Body& body);

  /// Counts and logs a call that is over.
  void Note(const grpc::ServerContextBase& context,
            Call call,
            const std::string& client,
            const Status& status,
            double duration_s);

  Status Send(const OpenSnapshot& snapshot,
              std::int64_t offset_bytes,
              grpc::ServerWriter<proto::FetchSnapshotResponse>* writer) const;
  Status Receive(const Caller& caller,
                 grpc::ServerReader<proto::UploadLogRequest>* reader,
                 proto::UploadState* response);
  Status AcceptLog(const Caller& caller, const std::string& sha256, const RunInfo& info);

  const ServiceParts parts_;
  std::mutex mutex_;
  bool ended_ = false;
  std::set<Watch*> watches_;
};

/// The other end of a call.
Peer PeerOf(const grpc::ServerContextBase& context);

/// As gRPC has it, with one line of text.
grpc::Status ToGrpc(const Status& status);

}  // namespace shiftmap::server
