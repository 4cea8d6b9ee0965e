// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/map_server.h"

#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <utility>

#include "mapstore/http/http_listener.h"
#include "mapstore/server/credentials.h"
#include "mapstore/server/map_service.h"

namespace shiftmap::server {
namespace {

using Clock = std::chrono::steady_clock;

// Two cores; each reader may hold a map.
constexpr int kReaders = 3;

// Calls at a time beside transfers, and what they may have in memory.
constexpr int kMaxShortCalls = 256;
constexpr std::size_t kMaxCallBytes = std::size_t{96} << 20;

// Writes that wait at a time.
constexpr std::size_t kMaxWaitingWrites = 1024;

// A connection begins anew now and then, so that it is checked against the authorities of the day.
constexpr int kConnectionAgeMs = 30 * 60 * 1000;
constexpr int kConnectionGraceMs = 30 * 60 * 1000;

// A vehicle that left the network is noticed.
constexpr int kKeepAliveMs = 60 * 1000;
constexpr int kKeepAliveTimeoutMs = 20 * 1000;

constexpr std::chrono::minutes kMaintainEvery{1};

// Beyond it something hangs: SQLite waits for a lock for 5 s. [s]
constexpr std::chrono::seconds kLongestStep{60};

StatusOr<MapStore> OpenStore(const MapServerOptions& options,
                             MapStore::Access access,
                             JsonLog* log) {
  MapStore::OpenOptions open;
  open.access = access;
  open.clock_tolerance_s = options.clock_tolerance_s;
  open.on_wait = [log] {
    log->Write(JsonLog::Level::kInfo, "another process holds the store", {});
  };
  return MapStore::Open(options.store, open);
}

StatusOr<std::vector<SnapshotSigner>> ReadSigners(const std::vector<std::string>& paths) {
  std::vector<SnapshotSigner> signers;
  for (const std::string& path : paths) {
    SHIFTMAP_ASSIGN_OR_RETURN(SnapshotSigner signer, SnapshotSigner::Read(path));
    signers.push_back(std::move(signer));
  }
  return signers;
}

HttpResponse MetricsResponse(const HttpRequest& request,
                             const std::function<std::string()>& metrics) {
  if (request.path != "/metrics") return {404, "only /metrics\n"};
  HttpResponse response(200, metrics());
  response.content_type = "text/plain; version=0.0.4; charset=utf-8";
  return response;
}

}  // namespace

struct MapServer::State {
  State(const MapServerOptions& given, JsonLog* json_log)
      : options(given),
        log(json_log),
        readers([this] { return OpenStore(options, MapStore::Access::kReadOnly, log); }, kReaders),
        transfers(given.max_transfers, given.max_streams_per_client),
        watches(given.max_watches, given.max_streams_per_client) {}

  Status OpenParts();
  Status Listen();
  std::vector<Gauge> Gauges() const;

  const MapServerOptions options;
  JsonLog* const log;
  ListenAddress address;
  Metrics metrics;
  SnapshotFeed feed;
  StoreReaders readers;
  Slots transfers;
  Slots watches;
  std::unique_ptr<StoreWriter> writer;
  std::unique_ptr<SnapshotFolder> snapshots;
  std::unique_ptr<SnapshotKeeper> keeper;
  std::unique_ptr<UploadSpool> uploads;
  std::unique_ptr<AccessGate> gate;
  std::unique_ptr<TlsCredentials> tls;  // Null: plain text.
  std::unique_ptr<MapService> service;
  std::unique_ptr<grpc::Server> server;
  std::optional<HttpListener> endpoint;  // Of the metrics.
  Clock::time_point maintained = Clock::now();
};

Status MapServer::State::OpenParts() {
  // The writer first: it takes up what an interrupted write left.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore store, OpenStore(options, MapStore::Access::kReadWrite, log));
  writer = std::make_unique<StoreWriter>(std::move(store), kMaxWaitingWrites);
  SHIFTMAP_ASSIGN_OR_RETURN(std::vector<SnapshotSigner> signers, ReadSigners(options.signing_keys));
  SHIFTMAP_ASSIGN_OR_RETURN(
      snapshots,
      SnapshotFolder::Open(options.snapshots, std::move(signers), options.keep_snapshots_s));
  // For exports: MapStore::ExportSnapshot of a store that may be written never meets a writer half
  // way.
  SHIFTMAP_ASSIGN_OR_RETURN(MapStore watched,
                            OpenStore(options, MapStore::Access::kReadWrite, log));
  keeper = std::make_unique<SnapshotKeeper>(
      std::move(watched), options.keeper, snapshots.get(), &feed, log);
  if (!options.logs.empty()) {
    SHIFTMAP_ASSIGN_OR_RETURN(uploads, UploadSpool::Open(options.logs, options.uploads));
  }
  std::unique_ptr<Revocations> revocations;
  if (options.tls) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        revocations,
        Revocations::Read(options.tls->revocations, options.tls->client_authority, log));
  }
  gate = std::make_unique<AccessGate>(std::move(revocations), options.calls_per_s);
  return OkStatus();
}

Status MapServer::State::Listen() {
  std::shared_ptr<grpc::ServerCredentials> credentials = grpc::InsecureServerCredentials();
  if (options.tls) {
    SHIFTMAP_ASSIGN_OR_RETURN(tls, TlsCredentials::Read(*options.tls, log));
    credentials = tls->get();
  }
  service = std::make_unique<MapService>(ServiceParts{&readers,
                                                      writer.get(),
                                                      snapshots.get(),
                                                      &feed,
                                                      uploads.get(),
                                                      gate.get(),
                                                      &transfers,
                                                      &watches,
                                                      &metrics,
                                                      log});
  grpc::EnableDefaultHealthCheckService(true);
  grpc::reflection::InitProtoReflectionServerBuilderPlugin();
  grpc::ResourceQuota quota("calls");
  quota.SetMaxThreads(options.max_transfers + kMaxShortCalls);
  quota.Resize(kMaxCallBytes);
  grpc::ServerBuilder builder;
  int port = 0;
  builder.AddListeningPort(options.listen.Text(), credentials, &port);
  builder.RegisterService(service.get());
  builder.SetResourceQuota(quota);
  builder.SetMaxReceiveMessageSize(static_cast<int>(options.max_message_bytes));
  // Another server on the port is an error, not one that shares it.
  builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT, 0);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONCURRENT_STREAMS, 4 * options.max_streams_per_client);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_MS, kConnectionAgeMs);
  builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_AGE_GRACE_MS, kConnectionGraceMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepAliveMs);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, kKeepAliveTimeoutMs);
  builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 10'000);
  builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
  server = builder.BuildAndStart();
  if (!server || port == 0) return Unavailable("cannot listen on {}", options.listen.Text());
  address = {options.listen.host, port};
  // By its name too: a probe may ask for either.
  server->GetHealthCheckService()->SetServingStatus(proto::MapServer::service_full_name(), true);
  server->GetHealthCheckService()->SetServingStatus(true);
  return OkStatus();
}

std::vector<Gauge> MapServer::State::Gauges() const {
  std::error_code error;
  const std::uintmax_t size = std::filesystem::file_size(options.store, error);
  const double store_bytes = error ? 0.0 : static_cast<double>(size);
  Gauge age{"shiftmap_published_version_age_seconds", "Since the published version was made.", {}};
  Gauge number{"shiftmap_published_version", "Number of the published version.", {}};
  Gauge held{"shiftmap_held_reports", "Reports about runs that are held.", {}};
  const Stamp now = SystemNow();
  for (const AreaState& area : keeper->areas()) {
    held.by_area.emplace_back(area.area, static_cast<double>(area.held_reports));
    if (!area.published) continue;
    number.by_area.emplace_back(area.area, static_cast<double>(area.published->value()));
    age.by_area.emplace_back(area.area, ToSeconds(now - area.created));
  }
  std::vector<Gauge> gauges = {{"shiftmap_store_bytes", "Size of the store.", {{"", store_bytes}}},
                               {"shiftmap_waiting_writes",
                                "Writes that wait for the store.",
                                {{"", static_cast<double>(writer->waiting())}}},
                               {"shiftmap_open_transfers",
                                "Downloads and uploads under way.",
                                {{"", static_cast<double>(transfers.taken())}}},
                               {"shiftmap_open_watches",
                                "Clients that watch for snapshots.",
                                {{"", static_cast<double>(watches.taken())}}},
                               std::move(number),
                               std::move(age),
                               std::move(held)};
  if (uploads) {
    gauges.push_back({"shiftmap_log_folder_bytes",
                      "Size of the log folder.",
                      {{"", static_cast<double>(uploads->folder_bytes())}}});
  }
  return gauges;
}

MapServer::MapServer(std::unique_ptr<State> state) : state_(std::move(state)) {}

MapServer::~MapServer() { Stop(std::chrono::milliseconds(0)); }

StatusOr<std::unique_ptr<MapServer>> MapServer::Start(const MapServerOptions& options,
                                                      JsonLog* log) {
  auto state = std::make_unique<State>(options, log);
  SHIFTMAP_RETURN_IF_ERROR(state->OpenParts());
  SHIFTMAP_RETURN_IF_ERROR(state->Listen());
  State* const parts = state.get();
  std::unique_ptr<MapServer> server(new MapServer(std::move(state)));
  if (options.metrics) {
    const auto text = [parts] { return parts->metrics.Text(parts->Gauges()); };
    StatusOr<HttpListener> endpoint = HttpListener::Start(
        *options.metrics,
        [text](const HttpRequest& request) { return MetricsResponse(request, text); });
    if (!endpoint.ok()) return Annotate(endpoint.status(), "metrics");
    parts->endpoint = *std::move(endpoint);
  }
  return server;
}

const ListenAddress& MapServer::address() const { return state_->address; }

std::optional<ListenAddress> MapServer::metrics_address() const {
  if (!state_->endpoint) return std::nullopt;
  return state_->endpoint->address();
}

std::int64_t MapServer::calls() const { return state_->metrics.calls(); }

bool MapServer::IsAlive() const {
  return state_->writer->busy() < kLongestStep && state_->keeper->idle() < kLongestStep;
}

void MapServer::Tend() {
  if (state_->tls) state_->tls->ReloadIfChanged();
  if (!state_->uploads || Clock::now() - state_->maintained < kMaintainEvery) return;
  state_->maintained = Clock::now();
  state_->uploads->Maintain();
}

void MapServer::Stop(std::chrono::milliseconds grace) {
  if (!state_->server) return;
  state_->server->GetHealthCheckService()->SetServingStatus(false);
  state_->service->EndWatches();
  state_->server->Shutdown(std::chrono::system_clock::now() + grace);
  state_->server->Wait();
  state_->endpoint.reset();
  state_->writer->Stop();
  state_->server.reset();
}

}  // namespace shiftmap::server
