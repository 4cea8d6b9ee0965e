// SPDX-License-Identifier: Apache-2.0
#include "mapstore/server/server_command.h"

#include <grpc/support/log.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <iostream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "mapstore/cli/input_options.h"
#include "mapstore/core/blocked_signals.h"
#include "mapstore/core/day.h"
#include "mapstore/core/service_notifier.h"
#include "mapstore/server/codec/map_service_codec.h"
#include "mapstore/server/map_server.h"

namespace shiftmap {
namespace {

using server::JsonLog;
using server::MapServer;
using server::MapServerOptions;

struct ServerArguments {
  MapServerOptions options;
  std::string listen;
  std::string tls_cert;
  std::string tls_key;
  std::string client_ca;
  std::string crl;
  bool plain_text = false;
  std::optional<std::string> metrics;
  double max_message_mib = 8.0;
  double max_log_mib = 4096.0;
  double vehicle_quota_mib = 51'200.0;
  double logs_quota_mib = 512'000.0;
  double keep_free_mib = 1024.0;
  double abandoned_upload_days = 7.0;
  double keep_snapshots_h = 24.0;
  double grace_s = 10.0;
};

constexpr double kMib = 1048576.0;
constexpr double kMostMib = 1e9;

std::int64_t ToBytes(double mib) { return static_cast<std::int64_t>(mib * kMib); }

// Nothing, or why the options do not go together.
std::string CheckArguments(const ServerArguments& arguments) {
  const auto listen = ParseListenAddress("--listen", arguments.listen);
  if (!listen.ok()) return Message(listen.status());
  if (arguments.metrics) {
    const auto metrics = ParseListenAddress("--metrics-listen", *arguments.metrics, "127.0.0.1");
    if (!metrics.ok()) return Message(metrics.status());
  }
  const bool any = !arguments.tls_cert.empty() || !arguments.tls_key.empty() ||
                   !arguments.client_ca.empty() || !arguments.crl.empty();
  const bool all =
      !arguments.tls_cert.empty() && !arguments.tls_key.empty() && !arguments.client_ca.empty();
  if (arguments.plain_text) {
    if (any) return "--development-plain-text and TLS exclude each other";
    if (!listen->IsLoopback()) {
      return fmt::format("--development-plain-text: --listen '{}' is no loopback address",
                         arguments.listen);
    }
    return "";
  }
  return all ? "" : "--tls-cert, --tls-key and --client-ca are required";
}

StatusOr<MapServerOptions> ToOptions(const ServerArguments& arguments) {
  MapServerOptions options = arguments.options;
  SHIFTMAP_ASSIGN_OR_RETURN(options.listen, ParseListenAddress("--listen", arguments.listen));
  if (!arguments.plain_text) {
    options.tls =
        server::TlsFiles{arguments.tls_cert, arguments.tls_key, arguments.client_ca, arguments.crl};
  }
  if (arguments.metrics) {
    SHIFTMAP_ASSIGN_OR_RETURN(
        options.metrics, ParseListenAddress("--metrics-listen", *arguments.metrics, "127.0.0.1"));
  }
  if (options.snapshots.empty()) options.snapshots = options.store + ".snapshots";
  options.max_message_bytes = ToBytes(arguments.max_message_mib);
  options.uploads.max_log_bytes = ToBytes(arguments.max_log_mib);
  options.uploads.max_client_bytes = ToBytes(arguments.vehicle_quota_mib);
  options.uploads.max_folder_bytes = ToBytes(arguments.logs_quota_mib);
  options.uploads.keep_free_bytes = ToBytes(arguments.keep_free_mib);
  options.uploads.abandoned_s = kSecondsPerDay * arguments.abandoned_upload_days;
  options.keep_snapshots_s = 3600.0 * arguments.keep_snapshots_h;
  return options;
}

// gRPC's own log, e.g. of handshakes that failed, has no user data.
std::atomic<JsonLog*> grpc_log = nullptr;

void LogGrpc(gpr_log_func_args* entry) {
  JsonLog* const log = grpc_log;
  if (log == nullptr) return;
  const JsonLog::Level level = entry->severity == GPR_LOG_SEVERITY_ERROR  ? JsonLog::Level::kWarning
                               : entry->severity == GPR_LOG_SEVERITY_INFO ? JsonLog::Level::kInfo
                                                                          : JsonLog::Level::kDebug;
  log->Write(level, "grpc", {{"message", entry->message}});
}

class GrpcLogging {
 public:
  explicit GrpcLogging(JsonLog* log) {
    server::SilenceProtobuf();
    grpc_log = log;
    gpr_set_log_function(&LogGrpc);
    gpr_set_log_verbosity(log->Writes(JsonLog::Level::kDebug) ? GPR_LOG_SEVERITY_INFO
                                                              : GPR_LOG_SEVERITY_ERROR);
  }
  ~GrpcLogging() { grpc_log = nullptr; }
  GrpcLogging(const GrpcLogging&) = delete;
  GrpcLogging& operator=(const GrpcLogging&) = delete;
};

Status RunServer(const ServerArguments& arguments, Context& context) {
  SHIFTMAP_ASSIGN_OR_RETURN(const MapServerOptions options, ToOptions(arguments));
  const BlockedSignals signals;
  JsonLog log(&std::cerr,
              context.quiet() ? JsonLog::Level::kError : JsonLog::LevelOf(context.log_level()));
  const GrpcLogging grpc_logging(&log);
  SHIFTMAP_ASSIGN_OR_RETURN(const std::unique_ptr<MapServer> map_server,
                            MapServer::Start(options, &log));
  server::Json listening = {{"address", map_server->address().Text()},
                            {"tls", options.tls.has_value()}};
  if (const auto metrics = map_server->metrics_address()) listening["metrics"] = metrics->Text();
  log.Write(JsonLog::Level::kInfo, "listening", listening);
  ServiceNotifier notifier;
  notifier.Ready();
  constexpr std::chrono::milliseconds kStep(500);
  while (!signals.WaitFor(std::min(kStep, notifier.interval().value_or(kStep)))) {
    if (map_server->IsAlive()) notifier.Alive();
    map_server->Tend();
  }
  notifier.Stopping();
  log.Write(JsonLog::Level::kInfo, "stopping", {});
  map_server->Stop(std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * arguments.grace_s)));
  const std::int64_t calls = map_server->calls();
  log.Write(JsonLog::Level::kInfo, "stopped", {{"calls", calls}});
  context.Report({{"calls", calls}}, fmt::format("{} calls answered\n", calls));
  return OkStatus();
}

void AddTlsOptions(ServerArguments* arguments, Command* command) {
  command
      ->Option("--tls-cert", &arguments->tls_cert, "The server's certificate with its chain, PEM")
      .Option("--tls-key", &arguments->tls_key, "Its key, PEM")
      .Option("--client-ca", &arguments->client_ca, "Authorities of client certificates, PEM")
      .Option("--crl", &arguments->crl, "Revoked certificates: CRLs of these authorities, PEM")
      .Flag("--development-plain-text",
            &arguments->plain_text,
            "No TLS, and every caller an operator; on a loopback address only");
}

void AddFolderOptions(ServerArguments* arguments, Command* command) {
  MapServerOptions& options = arguments->options;
  command
      ->Option("--snapshots",
               &options.snapshots,
               "Folder of snapshot files; <store>.snapshots by default")
      .Option("--snapshot-interval-s",
              &options.keeper.interval_s,
              "Least time between snapshots of one version [s]")
      .InRange(0.0, 86'400.0)
      .Option("--poll-s", &options.keeper.poll_s, "How often to look for what others publish [s]")
      .InRange(0.05, 60.0)
      .Option("--keep-snapshots-h",
              &arguments->keep_snapshots_h,
              "For how long a snapshot stays after another took its place [h]")
      .InRange(0.0, 10'000.0)
      .Option("--signing-key",
              &options.signing_keys,
              "Ed25519 key, PEM, that snapshots are signed with; several while keys change")
      .Option(
          "--logs", &options.logs, "Folder that run logs are uploaded to; none are taken without");
}

void AddLimitOptions(ServerArguments* arguments, Command* command) {
  MapServerOptions& options = arguments->options;
  command->Option("--max-message-mib", &arguments->max_message_mib, "Largest message [MiB]")
      .InRange(0.1, 64.0)
      .Option(
          "--calls-per-s", &options.calls_per_s, "Calls of one client, twice as many at once [1/s]")
      .InRange(0.1, 1e6)
      .Option("--max-transfers", &options.max_transfers, "Downloads and uploads at a time")
      .InRange(1, 4096)
      .Option("--max-watches", &options.max_watches, "Clients that wait for snapshots at a time")
      .InRange(1, 100'000)
      .Option("--max-streams-per-client",
              &options.max_streams_per_client,
              "Transfers, and as many watches, of one client at a time")
      .InRange(1, 1024)
      .Option("--max-log-mib", &arguments->max_log_mib, "Largest run log [MiB]")
      .InRange(1, kMostMib)
      .Option("--vehicle-quota-mib", &arguments->vehicle_quota_mib, "Run logs of one vehicle [MiB]")
      .InRange(1, kMostMib)
      .Option("--logs-quota-mib", &arguments->logs_quota_mib, "All run logs [MiB]")
      .InRange(1, kMostMib)
      .Option("--keep-free-mib",
              &arguments->keep_free_mib,
              "Space that uploads leave on the disk [MiB]")
      .InRange(0, kMostMib)
      .Option("--abandoned-upload-days",
              &arguments->abandoned_upload_days,
              "After which a part of a run log is removed [days]")
      .InRange(0.001, 10'000.0);
}

}  // namespace

void AddServerCommand(Application* application) {
  const auto arguments = std::make_shared<ServerArguments>();
  Command& command = application->AddCommand(
      "", "", [arguments](Context& context) { return RunServer(*arguments, context); });
  command.Option("--store", &arguments->options.store, "The map store")
      .Required()
      .Option(
          "--listen", &arguments->listen, "HOST:PORT; port 0 takes a free one, which the log names")
      .Required();
  AddTlsOptions(arguments.get(), &command);
  AddFolderOptions(arguments.get(), &command);
  AddLimitOptions(arguments.get(), &command);
  AddClockToleranceOption(&arguments->options.clock_tolerance_s, &command);
  command
      .Option("--metrics-listen",
              &arguments->metrics,
              "PORT on loopback, or HOST:PORT, for Prometheus; none without")
      .Option("--grace-s", &arguments->grace_s, "How long calls in flight may take at the end [s]")
      .InRange(0.0, 600.0)
      .Check([arguments] { return CheckArguments(*arguments); });
}

}  // namespace shiftmap
