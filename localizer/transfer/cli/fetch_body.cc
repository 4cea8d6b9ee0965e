// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <system_error>

#include "localizer/transfer/cli/signal_stop.h"
#include "localizer/transfer/cli/transfer_bodies.h"
#include "localizer/transfer/snapshot_fetch.h"
#include "mapstore/core/inert_text.h"

namespace shiftmap::transfer {

ServerOptions ServerOptionsOf(const ServerArguments& arguments) {
  return {.address = arguments.server,
          .tls_ca = arguments.tls_ca,
          .tls_cert = arguments.tls_cert,
          .tls_key = arguments.tls_key,
          .development_plain_text = arguments.development_plain_text};
}

Status RunFetch(const FetchArguments& arguments, Context& context) {
  FetchOptions options;
  options.area = arguments.area;
  options.output = arguments.output;
  options.backoff.give_up_s = arguments.server.give_up_s;
  options.max_bytes_per_s = 1024.0 * arguments.server.max_kib_per_s;
  options.dry_run = context.dry_run();
  SHIFTMAP_ASSIGN_OR_RETURN(options.keys, SnapshotKeys::Read(arguments.snapshot_keys));
  const SignalStop stop;
  SHIFTMAP_ASSIGN_OR_RETURN(MapClient client,
                            MapClient::Create(ServerOptionsOf(arguments.server), stop.token()));
  const std::unique_ptr<Progress> progress = context.MakeProgress();
  options.progress = [&progress](double done) { progress->Update("fetching", done); };
  const StatusOr<FetchResult> result = FetchSnapshot(&client, options);
  if (!result.ok()) {
    const std::string part = arguments.output + ".part";
    std::error_code unknown;
    const bool begun = std::filesystem::exists(part, unknown);
    SHIFTMAP_RETURN_IF_ERROR(
        StopSignals::Check(fmt::format("snapshot '{}': fetch", arguments.output),
                           begun ? fmt::format("the next one goes on from '{}'", part)
                                 : std::string("nothing is written")));
    return result.status();
  }
  const SnapshotInfo& snapshot = result->snapshot;
  const std::string what = fmt::format("area '{}' version {}, ledger up to report {}",
                                       snapshot.area,
                                       snapshot.version.value(),
                                       snapshot.ledger_sequence.value());
  context.Report({{"area", snapshot.area},
                  {"version", snapshot.version.value()},
                  {"content_hash", snapshot.content_hash},
                  {"ledger_sequence", snapshot.ledger_sequence.value()},
                  {"sha256", snapshot.sha256},
                  {"size_bytes", snapshot.size_bytes},
                  {"output", arguments.output},
                  {"changed", !result->not_changed},
                  {"resumed_bytes", result->resumed_bytes},
                  {"received_bytes", result->received_bytes},
                  {"retries", result->retries}},
                 fmt::format("{}: {}, {} bytes{}\n",
                             InertLine(arguments.output),
                             InertLine(what),
                             snapshot.size_bytes,
                             result->not_changed ? ", not changed" : ""));
  if (!result->not_changed) return OkStatus();
  return MakeStatus(
      StatusCode::kAlreadyExists, "snapshot '{}': not changed: it is {}", arguments.output, what);
}

}  // namespace shiftmap::transfer
