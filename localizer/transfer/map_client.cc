// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/map_client.h"

#include <google/protobuf/stubs/logging.h>
#include <grpc/support/log.h>
#include <grpcpp/grpcpp.h>

#include <chrono>
#include <optional>
#include <utility>

#include "mapstore/core/clock.h"
#include "mapstore/core/pem.h"
#include "proto/map_server.grpc.pb.h"

namespace shiftmap::transfer {
namespace {

// Of the connection, below our own tries. [ms]
constexpr int kFirstReconnectMs = 100;
constexpr int kLongestReconnectMs = 1000;
constexpr int kConnectTimeoutMs = 10'000;
constexpr int kKeepaliveMs = 20'000;
constexpr int kKeepaliveTimeoutMs = 10'000;

// The codes of gRPC are those of absl. Some of them mean something else to a caller here.
StatusCode CodeOf(const grpc::Status& status, bool stopped) {
  switch (status.error_code()) {
    case grpc::StatusCode::CANCELLED:
      // A server that ends cancels what is under way.
      return stopped ? StatusCode::kCancelled : StatusCode::kUnavailable;
    case grpc::StatusCode::UNKNOWN:
      // No call of this service answers so: the stream broke before its status came.
      return StatusCode::kUnavailable;
    default:
      return static_cast<StatusCode>(status.error_code());
  }
}

SnapshotInfo FromProto(const proto::Snapshot& in) {
  SnapshotInfo snapshot{.area = in.area(),
                        .version = VersionNumber(in.version()),
                        .content_hash = in.content_hash(),
                        .ledger_sequence = LedgerPosition(in.ledger_sequence()),
                        .created = StampFromNanoseconds(in.created_ns()),
                        .sha256 = in.sha256(),
                        .size_bytes = in.size_bytes(),
                        .signatures = {}};
  for (const proto::SnapshotSignature& signature : in.signature()) {
    snapshot.signatures.push_back({signature.key_sha256(), signature.signature()});
  }
  return snapshot;
}

UploadState FromProto(const proto::UploadState& in) { return {in.stored_bytes(), in.complete()}; }

// Errors are returned, and a command says each in one line: the libraries' own would be beside it.
void SilenceLibraries() {
  google::protobuf::SetLogHandler(nullptr);
  gpr_set_log_function([](gpr_log_func_args*) {});
}

// What may be wrong with the client's own certificate.
struct CertificateDates {
  std::string note;  // Empty: nothing.
  bool over = false;
};

// A server that refuses a certificate says no more than that the connection broke.
CertificateDates DatesOf(const ServerOptions& options, const X509* certificate) {
  const std::optional<CertificateTimes> times = TimesOf(certificate);
  const Stamp now = SystemNow();
  if (!times || (times->begin <= now && now <= times->end)) return {};
  return {fmt::format("; client certificate '{}' holds from {} to {}, and it is {}",
                      options.tls_cert,
                      FormatUtc(times->begin),
                      FormatUtc(times->end),
                      FormatUtc(now)),
          now > times->end};
}

// Whether a connection that failed will fail until somebody renews or replaces a certificate. A
// clock that is behind may be set yet.
bool IsForGood(const CertificateDates& own, const std::string& error) {
  return own.over ||
         (own.note.empty() && error.find("certificate verify failed") != std::string::npos);
}

// @param dates  Gets those of the client's certificate.
StatusOr<std::shared_ptr<grpc::ChannelCredentials>> Credentials(const ServerOptions& options,
                                                                CertificateDates* dates) {
  if (options.development_plain_text) return grpc::InsecureChannelCredentials();
  grpc::SslCredentialsOptions tls;
  SHIFTMAP_ASSIGN_OR_RETURN(tls.pem_root_certs, ReadCertificates("authority", options.tls_ca));
  SHIFTMAP_ASSIGN_OR_RETURN(TlsIdentity identity,
                            ReadTlsIdentity("client", options.tls_cert, options.tls_key));
  *dates = DatesOf(options, identity.certificate.get());
  tls.pem_cert_chain = std::move(identity.certificates);
  tls.pem_private_key = std::move(identity.key);
  return grpc::SslCredentials(tls);
}

}  // namespace

struct MapClient::State {
  // The context of one call, which a request to stop cancels.
  class Call {
   public:
    Call(const std::stop_token& stop, double deadline_s)
        : cancel_(stop, [this] { context_.TryCancel(); }) {
      context_.set_deadline(std::chrono::system_clock::now() +
                            std::chrono::duration_cast<std::chrono::system_clock::duration>(
                                std::chrono::duration<double>(deadline_s)));
    }
    grpc::ClientContext* get() { return &context_; }

   private:
    grpc::ClientContext context_;
    std::stop_callback<std::function<void()>> cancel_;
  };

  Status About(const grpc::Status& status) const {
    if (status.ok()) return OkStatus();
    const StatusCode code = CodeOf(status, stop.stop_requested());
    const bool broke = code == StatusCode::kUnavailable;
    return MakeStatus(
        broke && IsForGood(dates, status.error_message()) ? StatusCode::kUnauthenticated : code,
        "server '{}': {}{}",
        options.address,
        status.error_message().empty() ? "the connection broke" : status.error_message(),
        broke ? dates.note : "");
  }

  Status About(const Status& status) const {
    return Annotate(status, "server '{}'", options.address);
  }

  ServerOptions options;
  CertificateDates dates;
  std::stop_token stop;
  std::unique_ptr<proto::MapServer::Stub> stub;
};

StatusOr<MapClient> MapClient::Create(const ServerOptions& options, std::stop_token stop) {
  auto state = std::make_unique<State>();
  SHIFTMAP_ASSIGN_OR_RETURN(const std::shared_ptr<grpc::ChannelCredentials> credentials,
                            Credentials(options, &state->dates));
  SilenceLibraries();
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_RETRIES, 0);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, kFirstReconnectMs);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, kLongestReconnectMs);
  // Also the time that a connection may take.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, kConnectTimeoutMs);
  // A link that went silent is given up.
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepaliveMs);
  arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepaliveTimeoutMs);
  // Each client has its own connection.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  state->options = options;
  state->stop = std::move(stop);
  state->stub =
      proto::MapServer::NewStub(grpc::CreateCustomChannel(options.address, credentials, arguments));
  return MapClient(std::move(state));
}

MapClient::MapClient(std::unique_ptr<State> state) : state_(std::move(state)) {}
MapClient::MapClient(MapClient&&) noexcept = default;
MapClient& MapClient::operator=(MapClient&&) noexcept = default;
MapClient::~MapClient() = default;

std::stop_token MapClient::stop() const { return state_->stop; }

StatusOr<SnapshotInfo> MapClient::GetSnapshot(const std::string& area) {
  State::Call call(state_->stop, state_->options.call_deadline_s);
  proto::GetSnapshotRequest request;
  request.set_area(area);
  proto::Snapshot snapshot;
  SHIFTMAP_RETURN_IF_ERROR(
      state_->About(state_->stub->GetSnapshot(call.get(), request, &snapshot)));
  return FromProto(snapshot);
}

Status MapClient::FetchSnapshot(const SnapshotInfo& snapshot,
                                std::int64_t offset_bytes,
                                const std::function<Status(std::string_view)>& take) {
  State::Call call(state_->stop, state_->options.stream_deadline_s);
  proto::FetchSnapshotRequest request;
  request.set_area(snapshot.area);
  request.set_sha256(snapshot.sha256);
  request.set_offset_bytes(offset_bytes);
  const auto stream = state_->stub->FetchSnapshot(call.get(), request);
  std::int64_t left = snapshot.size_bytes - offset_bytes;
  Status failed = OkStatus();
  proto::FetchSnapshotResponse response;
  while (failed.ok() && stream->Read(&response)) {
    if (response.has_snapshot()) {
      if (response.snapshot().sha256() != snapshot.sha256) {
        failed = state_->About(DataLoss(
            "it sends snapshot {}, expected {}", response.snapshot().sha256(), snapshot.sha256));
      }
      continue;
    }
    left -= static_cast<std::int64_t>(response.data().size());
    failed = left < 0 ? state_->About(DataLoss("it sends more than the {} bytes of snapshot {}",
                                               snapshot.size_bytes,
                                               snapshot.sha256))
                      : take(response.data());
  }
  if (!failed.ok()) call.get()->TryCancel();
  const grpc::Status status = stream->Finish();
  return failed.ok() ? state_->About(status) : failed;
}

StatusOr<SubmitResult> MapClient::SubmitReport(const std::string& report) {
  State::Call call(state_->stop, state_->options.call_deadline_s);
  proto::SubmitReportRequest request;
  if (!request.mutable_report()->ParseFromString(report)) {
    return InvalidArgument("not a shift report");
  }
  proto::SubmitReportResponse response;
  SHIFTMAP_RETURN_IF_ERROR(
      state_->About(state_->stub->SubmitReport(call.get(), request, &response)));
  SubmitResult result{.duplicate = response.duplicate(),
                      .evidence_rows = response.evidence_rows(),
                      .set_aside = {}};
  for (const proto::SetAsideEntry& entry : response.set_aside()) {
    result.set_aside.push_back({entry.reason(), entry.rows()});
  }
  return result;
}

StatusOr<UploadState> MapClient::GetUpload(const std::string& sha256) {
  State::Call call(state_->stop, state_->options.call_deadline_s);
  proto::GetUploadRequest request;
  request.set_sha256(sha256);
  proto::UploadState upload;
  SHIFTMAP_RETURN_IF_ERROR(state_->About(state_->stub->GetUpload(call.get(), request, &upload)));
  return FromProto(upload);
}

StatusOr<UploadState> MapClient::UploadLog(const std::string& sha256,
                                           std::int64_t size_bytes,
                                           std::int64_t offset_bytes,
                                           const std::function<StatusOr<std::string>()>& next) {
  State::Call call(state_->stop, state_->options.stream_deadline_s);
  proto::UploadState upload;
  const auto stream = state_->stub->UploadLog(call.get(), &upload);
  proto::UploadLogRequest request;
  proto::UploadHeader& header = *request.mutable_header();
  header.set_sha256(sha256);
  header.set_size_bytes(size_bytes);
  header.set_offset_bytes(offset_bytes);
  bool open = stream->Write(request);
  Status failed = OkStatus();
  while (open) {
    StatusOr<std::string> bytes = next();
    failed = bytes.status();
    if (!failed.ok() || bytes->empty()) break;
    request.set_data(*std::move(bytes));
    open = stream->Write(request);
  }
  if (failed.ok()) {
    stream->WritesDone();
  } else {
    call.get()->TryCancel();
  }
  const grpc::Status status = stream->Finish();
  if (!failed.ok()) return failed;
  SHIFTMAP_RETURN_IF_ERROR(state_->About(status));
  return FromProto(upload);
}

Status MapClient::WatchSnapshots(const std::string& area,
                                 const std::function<void(const SnapshotInfo&)>& take) {
  State::Call call(state_->stop, state_->options.stream_deadline_s);
  proto::WatchSnapshotsRequest request;
  request.set_area(area);
  const auto stream = state_->stub->WatchSnapshots(call.get(), request);
  proto::Snapshot snapshot;
  while (stream->Read(&snapshot)) take(FromProto(snapshot));
  const grpc::Status status = stream->Finish();
  if (status.error_code() == grpc::StatusCode::DEADLINE_EXCEEDED) return OkStatus();
  return state_->About(status);
}

}  // namespace shiftmap::transfer
