// SPDX-License-Identifier: Apache-2.0
#include "tests/support/fake_map_server.h"

#include <fmt/format.h>
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <set>

#include "mapstore/map/sha256.h"
#include "proto/core/check.h"
#include "proto/map_server.grpc.pb.h"

namespace shiftmap::testing {
namespace {

constexpr std::size_t kMessageBytes = 4096;

std::string Hash(const std::string& bytes) {
  Sha256 hash;
  hash.Update(bytes);
  return hash.HexDigest();
}

}  // namespace

struct FakeMapServer::State : proto::MapServer::Service {
  grpc::Status GetSnapshot(grpc::ServerContext*,
                           const proto::GetSnapshotRequest* request,
                           proto::Snapshot* response) override {
    const std::lock_guard lock(mutex);
    if (const auto status = Fail(/*late=*/false); !status.ok()) return status;
    if (request->area() != "floor" || snapshots.empty()) return NoSuchArea();
    *response = Describe(snapshots.back());
    return Fail(/*late=*/true);
  }

  grpc::Status FetchSnapshot(grpc::ServerContext*,
                             const proto::FetchSnapshotRequest* request,
                             grpc::ServerWriter<proto::FetchSnapshotResponse>* writer) override {
    Snapshot snapshot;
    std::int64_t cut = 0;
    {
      const std::lock_guard lock(mutex);
      if (const auto status = Fail(/*late=*/false); !status.ok()) return status;
      bool found = false;
      for (const Snapshot& candidate : snapshots) {
        if (Hash(candidate.bytes) != request->sha256()) continue;
        snapshot = candidate;
        found = true;
      }
      if (!found) return NoSuchArea();
      cut = cut_after;
    }
    proto::FetchSnapshotResponse response;
    *response.mutable_snapshot() = Describe(snapshot);
    writer->Write(response);
    auto at = static_cast<std::size_t>(request->offset_bytes());
    for (std::size_t sent = 0; at < snapshot.bytes.size();) {
      if (cut > 0 && sent >= static_cast<std::size_t>(cut)) return Cut();
      const std::string data = snapshot.bytes.substr(at, kMessageBytes);
      response.set_data(data);
      writer->Write(response);
      at += data.size();
      sent += data.size();
    }
    return grpc::Status::OK;
  }

  grpc::Status SubmitReport(grpc::ServerContext*,
                            const proto::SubmitReportRequest* request,
                            proto::SubmitReportResponse* response) override {
    const std::lock_guard lock(mutex);
    if (const auto status = Fail(/*late=*/false); !status.ok()) return status;
    if (refused.count(request->report().uuid()) != 0) {
      return {grpc::StatusCode::INVALID_ARGUMENT, "report refused"};
    }
    response->set_duplicate(++submitted[request->report().uuid()] > 1);
    response->set_evidence_rows(request->report().evidence_size());
    return Fail(/*late=*/true);
  }

  grpc::Status GetUpload(grpc::ServerContext*,
                         const proto::GetUploadRequest* request,
                         proto::UploadState* response) override {
    const std::lock_guard lock(mutex);
    if (const auto status = Fail(/*late=*/false); !status.ok()) return status;
    const std::string& bytes = uploads[request->sha256()];
    response->set_stored_bytes(static_cast<std::int64_t>(bytes.size()));
    response->set_complete(Hash(bytes) == request->sha256());
    return grpc::Status::OK;
  }

  grpc::Status UploadLog(grpc::ServerContext*,
                         grpc::ServerReader<proto::UploadLogRequest>* reader,
                         proto::UploadState* response) override {
    proto::UploadLogRequest request;
    if (!reader->Read(&request)) return Cut();
    const proto::UploadHeader header = request.header();
    std::int64_t cut = 0;
    {
      const std::lock_guard lock(mutex);
      if (const auto status = Fail(/*late=*/false); !status.ok()) return status;
      if (refused.count(header.sha256()) != 0) {
        return {grpc::StatusCode::INVALID_ARGUMENT, "log refused"};
      }
      if (static_cast<std::int64_t>(uploads[header.sha256()].size()) != header.offset_bytes()) {
        return {grpc::StatusCode::OUT_OF_RANGE, "another offset"};
      }
      cut = cut_after;
    }
    std::size_t came = 0;
    while (reader->Read(&request)) {
      const std::lock_guard lock(mutex);
      uploads[header.sha256()] += request.data();
      came += request.data().size();
      if (cut > 0 && came >= static_cast<std::size_t>(cut)) return Cut();
    }
    const std::lock_guard lock(mutex);
    std::string& bytes = uploads[header.sha256()];
    const bool whole = static_cast<std::int64_t>(bytes.size()) == header.size_bytes();
    if (whole && Hash(bytes) != header.sha256()) {
      bytes.clear();
      return {grpc::StatusCode::DATA_LOSS, "another hash"};
    }
    response->set_stored_bytes(static_cast<std::int64_t>(bytes.size()));
    response->set_complete(whole);
    return Fail(/*late=*/true);
  }

  grpc::Status WatchSnapshots(grpc::ServerContext* context,
                              const proto::WatchSnapshotsRequest*,
                              grpc::ServerWriter<proto::Snapshot>* writer) override {
    std::size_t told = 0;
    std::unique_lock lock(mutex);
    while (!context->IsCancelled() && !ending) {
      if (snapshots.size() > told) {
        told = snapshots.size();
        writer->Write(Describe(snapshots.back()));
      }
      published.wait_for(lock, std::chrono::milliseconds(20));
    }
    return grpc::Status::OK;
  }

  // With the mutex held.
  grpc::Status Fail(bool late) {
    if (!late) ++calls;
    if (failures == 0 || late != fail_late) return grpc::Status::OK;
    --failures;
    return {static_cast<grpc::StatusCode>(code), "told to fail"};
  }

  static grpc::Status Cut() { return {grpc::StatusCode::UNAVAILABLE, "cut"}; }
  static grpc::Status NoSuchArea() { return {grpc::StatusCode::NOT_FOUND, "no such area"}; }

  static proto::Snapshot Describe(const Snapshot& snapshot) {
    proto::Snapshot out;
    out.set_area("floor");
    out.set_version(snapshot.version);
    out.set_content_hash(snapshot.content_hash);
    out.set_ledger_sequence(snapshot.ledger_sequence);
    out.set_sha256(Hash(snapshot.bytes));
    out.set_size_bytes(static_cast<std::int64_t>(snapshot.bytes.size()));
    if (!snapshot.key_sha256.empty()) {
      proto::SnapshotSignature& signature = *out.add_signature();
      signature.set_key_sha256(snapshot.key_sha256);
      signature.set_signature(snapshot.signature);
    }
    return out;
  }

  std::mutex mutex;
  std::condition_variable published;
  std::vector<Snapshot> snapshots;
  std::map<std::string, int> submitted;
  std::map<std::string, std::string> uploads;
  std::set<std::string> refused;
  int calls = 0;
  int failures = 0;
  int code = 0;
  bool fail_late = false;
  bool ending = false;
  std::int64_t cut_after = 0;
  int port = 0;
  std::unique_ptr<grpc::Server> server;
};

FakeMapServer::FakeMapServer() : state_(std::make_unique<State>()) {
  grpc::ServerBuilder builder;
  builder.AddListeningPort("127.0.0.1:0", grpc::InsecureServerCredentials(), &state_->port);
  builder.RegisterService(state_.get());
  state_->server = builder.BuildAndStart();
  SHIFTMAP_CHECK(state_->server != nullptr, "port {}", state_->port);
}

FakeMapServer::~FakeMapServer() {
  {
    const std::lock_guard lock(state_->mutex);
    state_->ending = true;
  }
  state_->published.notify_all();
  state_->server->Shutdown(std::chrono::system_clock::now() + std::chrono::seconds(2));
}

std::string FakeMapServer::address() const { return fmt::format("127.0.0.1:{}", state_->port); }

int FakeMapServer::port() const { return state_->port; }

void FakeMapServer::Publish(const Snapshot& snapshot) {
  const std::lock_guard lock(state_->mutex);
  state_->snapshots.push_back(snapshot);
  state_->published.notify_all();
}

void FakeMapServer::FailNext(int calls, int code, bool late) {
  const std::lock_guard lock(state_->mutex);
  state_->failures = calls;
  state_->code = code;
  state_->fail_late = late;
}

void FakeMapServer::CutStreamsAfter(std::int64_t bytes) {
  const std::lock_guard lock(state_->mutex);
  state_->cut_after = bytes;
}

std::map<std::string, int> FakeMapServer::reports() const {
  const std::lock_guard lock(state_->mutex);
  return state_->submitted;
}

std::map<std::string, std::string> FakeMapServer::logs() const {
  const std::lock_guard lock(state_->mutex);
  std::map<std::string, std::string> whole;
  for (const auto& [sha256, bytes] : state_->uploads) {
    if (Hash(bytes) == sha256) whole[sha256] = bytes;
  }
  return whole;
}

int FakeMapServer::calls() const {
  const std::lock_guard lock(state_->mutex);
  return state_->calls;
}

void FakeMapServer::Refuse(const std::string& name) {
  const std::lock_guard lock(state_->mutex);
  state_->refused.insert(name);
}

}  // namespace shiftmap::testing
