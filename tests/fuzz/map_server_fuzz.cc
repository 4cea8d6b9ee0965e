// SPDX-License-Identifier: Apache-2.0
//
// Sends the input to a call of a map server, as the bytes of one or more messages, over a
// connection. The server must answer, go on answering, and leave a store that can be read. The
// first byte names the call, unless SHIFTMAP_FUZZ_PART does.
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <cstdlib>
#include <iostream>
#include <iterator>
#include <memory>
#include <optional>
#include <random>
#include <string_view>

#include "mapstore/codec/shift_report.h"
#include "mapstore/server/map_server.h"
#include "proto/core/check.h"
#include "proto/map_server.pb.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"
#include "tests/support/random_map.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

constexpr const char* kCalls[] = {"ListAreas",
                                  "ListVersions",
                                  "GetSnapshot",
                                  "FetchSnapshot",
                                  "GetModeProbabilities",
                                  "SubmitReport",
                                  "GetUpload",
                                  "UploadLog",
                                  "WatchSnapshots"};
constexpr std::size_t kUpload = 7;
constexpr std::size_t kWatch = 8;

// A server over a store with one small area, for all inputs.
class FuzzedServer {
 public:
  FuzzedServer() : log_(&std::cerr, server::JsonLog::Level::kOff) {
    std::mt19937_64 random(1);
    RandomMapOptions map;
    map.groups = 3;
    const MapContent content = RandomContent(random, map);
    const std::string path = dir_.File("maps.db");
    StatusOr<MapStore> store = MapStore::Open(path, MapStore::Access::kReadWriteCreate);
    SHIFTMAP_CHECK(store.ok(), "{}", Message(store.status()));
    const auto committed = store->Commit("level", content, {}, {});
    SHIFTMAP_CHECK(committed.ok(), "{}", Message(committed.status()));
    report_.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
    report_.vehicle = "truck";
    report_.area = "level";
    report_.version = committed->version;
    report_.content_hash = committed->content_hash;
    report_.software = "fuzz";
    report_.begin = content.stamp;
    report_.end = content.stamp + std::chrono::hours(1);
    report_.evidence = {RandomEvidence(random, content.groups.front(), report_.begin, report_.end)};
    server::MapServerOptions options;
    options.store = path;
    options.snapshots = dir_.File("snapshots");
    options.logs = dir_.File("logs");
    options.uploads.max_folder_bytes = 1 << 20;
    options.uploads.keep_free_bytes = 0;
    options.calls_per_s = 1e9;
    options.listen = {"127.0.0.1", 0};
    auto started = server::MapServer::Start(options, &log_);
    SHIFTMAP_CHECK(started.ok(), "{}", Message(started.status()));
    server_ = *std::move(started);
    stub_ = std::make_unique<grpc::GenericStub>(
        grpc::CreateChannel(server_->address().Text(), grpc::InsecureChannelCredentials()));
  }

  const ShiftReport& report() const { return report_; }

  /// Makes a call and reads the answer to its end.
  grpc::Status Call(std::size_t call, const std::vector<std::string>& messages) {
    grpc::ClientContext context;
    const auto stream = stub_->PrepareCall(
        &context, std::string("/shiftmap.proto.MapServer/") + kCalls[call], &queue_);
    stream->StartCall(nullptr);
    bool goes_on = Next();
    for (const std::string& message : messages) {
      if (!goes_on) break;
      const grpc::Slice slice(message);
      stream->Write(grpc::ByteBuffer(&slice, 1), nullptr);
      goes_on = Next();
    }
    if (goes_on) {
      stream->WritesDone(nullptr);
      Next();
    }
    // It would wait for the next snapshot.
    if (call == kWatch) context.TryCancel();
    grpc::ByteBuffer answer;
    do {
      stream->Read(&answer, nullptr);
    } while (Next());
    grpc::Status status;
    stream->Finish(&status, nullptr);
    SHIFTMAP_CHECK(Next(), "the call does not end");
    return status;
  }

 private:
  bool Next() {
    void* tag = nullptr;
    bool ok = false;
    SHIFTMAP_CHECK(queue_.Next(&tag, &ok), "the queue ended");
    return ok;
  }

  TempDir dir_;
  server::JsonLog log_;
  ShiftReport report_;
  std::unique_ptr<server::MapServer> server_;
  std::unique_ptr<grpc::GenericStub> stub_;
  grpc::CompletionQueue queue_;
};

FuzzedServer& TheServer() {
  static FuzzedServer server;
  return server;
}

// The call that all inputs go to; nothing: each says which.
std::optional<std::size_t> TheCall() {
  const char* const name = std::getenv("SHIFTMAP_FUZZ_PART");
  if (name == nullptr) return std::nullopt;
  const auto* const found = std::find(std::begin(kCalls), std::end(kCalls), std::string_view(name));
  SHIFTMAP_CHECK(found != std::end(kCalls), "no call {}", name);
  return static_cast<std::size_t>(found - std::begin(kCalls));
}

// The bytes of a call as an input.
void AddSeed(std::size_t call, const std::string& bytes, std::vector<std::string>* seeds) {
  const std::optional<std::size_t> only = TheCall();
  if (!only) seeds->push_back(static_cast<char>(call) + bytes);
  if (only == call) seeds->push_back(bytes);
}

// A message with its length before it.
std::string Framed(const google::protobuf::Message& message) {
  const std::string bytes = message.SerializeAsString();
  return {static_cast<char>(bytes.size() >> 8), static_cast<char>(bytes.size())};
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  proto::GetModeProbabilitiesRequest probabilities;
  probabilities.set_area("level");
  probabilities.set_at_ns(INT64_MAX);
  proto::FetchSnapshotRequest fetch;
  fetch.set_area("level");
  fetch.set_have_sha256(std::string(64, 'a'));
  proto::SubmitReportRequest submit;
  submit.mutable_report()->ParseFromString(EncodeShiftReport(TheServer().report()));
  proto::GetUploadRequest upload;
  upload.set_sha256(std::string(64, 'b'));
  proto::UploadLogRequest header;
  header.mutable_header()->set_sha256(std::string(64, 'b'));
  header.mutable_header()->set_size_bytes(4);
  proto::UploadLogRequest data;
  data.set_data("\x89MCAP");
  proto::WatchSnapshotsRequest watch;
  watch.set_area("level");
  std::vector<std::string> seeds;
  AddSeed(0, "", &seeds);
  AddSeed(1, watch.SerializeAsString(), &seeds);
  AddSeed(2, watch.SerializeAsString(), &seeds);
  AddSeed(3, fetch.SerializeAsString(), &seeds);
  AddSeed(4, probabilities.SerializeAsString(), &seeds);
  AddSeed(5, submit.SerializeAsString(), &seeds);
  AddSeed(6, upload.SerializeAsString(), &seeds);
  AddSeed(kUpload,
          Framed(header) + header.SerializeAsString() + Framed(data) + data.SerializeAsString(),
          &seeds);
  AddSeed(kWatch, watch.SerializeAsString(), &seeds);
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  FuzzInput input(bytes);
  static const std::optional<std::size_t> only = TheCall();
  const std::size_t call = only ? *only : input.Index(std::size(kCalls));
  std::vector<std::string> messages;
  while (call == kUpload && !input.empty()) {
    messages.emplace_back(input.TakeBytes(input.Take(2)));
  }
  if (call != kUpload) messages.emplace_back(input.rest());
  TheServer().Call(call, messages);
  const grpc::Status status = TheServer().Call(0, {""});
  SHIFTMAP_CHECK(status.ok(), "after {}: {}", kCalls[call], status.error_message());
}

}  // namespace shiftmap::testing
