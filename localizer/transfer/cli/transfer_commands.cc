// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/cli/transfer_commands.h"

#include <memory>
#include <utility>

#include "localizer/transfer/server_options.h"
#include "mapstore/cli/input_options.h"

namespace shiftmap {
namespace {

std::string CheckReturn(const ReturnArguments& arguments) {
  if (!arguments.store.empty()) return "";
  return arguments.server.server.empty() ? "give either --store or --server, one is required"
                                         : CheckServerArguments(arguments.server);
}

std::string CheckSync(const SyncArguments& arguments) {
  const bool vda5050 = arguments.map_source == "vda5050";
  if (vda5050 && arguments.socket.empty()) return "--map-source vda5050 needs --socket";
  // Maps come by link: without a server, nothing is handed in.
  const bool only_maps = vda5050 && arguments.server.server.empty() && !arguments.once;
  if (std::string message = CheckServerArguments(arguments.server);
      !only_maps && !message.empty()) {
    return message;
  }
  return arguments.map_source == "server" && arguments.area.empty()
             ? "--map-source server needs --area"
             : "";
}

}  // namespace

void AddServerOptions(ServerArguments* arguments, Command* command) {
  command->Option("--server", &arguments->server, "Map server, HOST:PORT")
      .Option("--tls-ca", &arguments->tls_ca, "Certificate of the authority, PEM")
      .Option("--tls-cert", &arguments->tls_cert, "Certificate of this vehicle, PEM")
      .Option("--tls-key", &arguments->tls_key, "Its private key, PEM")
      .Flag("--development-plain-text",
            &arguments->development_plain_text,
            "Without TLS, to a server on this host only")
      .Option("--give-up-s",
              &arguments->give_up_s,
              "Try again after failures until nothing went through for so long")
      .InRange(0.0, 1e7)
      .Option("--max-kib-per-s",
              &arguments->max_kib_per_s,
              "Bound of what files take of the link; 0: none")
      .InRange(0.0, 1e9);
}

std::string CheckServerArguments(const ServerArguments& arguments) {
  return transfer::CheckServerOptions({.address = arguments.server,
                                       .tls_ca = arguments.tls_ca,
                                       .tls_cert = arguments.tls_cert,
                                       .tls_key = arguments.tls_key,
                                       .development_plain_text = arguments.development_plain_text});
}

void AddFetchCommand(Application* application, TransferBody<FetchArguments> body) {
  auto arguments = std::make_shared<FetchArguments>();
  Command& command = application->AddCommand(
      "fetch",
      "Fetch the newest snapshot of an area from the map server",
      [arguments, body = std::move(body)](Context& context) { return body(*arguments, context); });
  AddServerOptions(&arguments->server, &command);
  command.Option("--area", &arguments->area, "Area")
      .Required()
      .Option("--output", &arguments->output, "Snapshot file to write")
      .Output()
      .Required()
      .Option("--snapshot-key",
              &arguments->snapshot_keys,
              "Ed25519 public key, PEM; the snapshot must be signed by one of those given")
      .Check([arguments] { return CheckServerArguments(arguments->server); })
      .Writes();
}

void AddReturnCommand(Application* application, TransferBody<ReturnArguments> body) {
  auto arguments = std::make_shared<ReturnArguments>();
  Command& command = application->AddCommand(
      "return",
      "Hand shift reports back to the map store, or to the map server",
      [arguments, body = std::move(body)](Context& context) { return body(*arguments, context); });
  AddServerOptions(&arguments->server, &command);
  command.Option("--store", &arguments->store, "Map store to return to")
      .Excludes("--server")
      .Option("REPORT", &arguments->reports, "Shift reports")
      .Required();
  AddClockToleranceOption(&arguments->clock_tolerance_s, &command);
  command.Check([arguments] { return CheckReturn(*arguments); }).Writes();
}

void AddUploadCommand(Application* application, TransferBody<UploadArguments> body) {
  auto arguments = std::make_shared<UploadArguments>();
  Command& command = application->AddCommand(
      "upload",
      "Upload run logs to the map server",
      [arguments, body = std::move(body)](Context& context) { return body(*arguments, context); });
  AddServerOptions(&arguments->server, &command);
  command.Option("LOG", &arguments->logs, "Run logs (MCAP)")
      .Required()
      .Check([arguments] { return CheckServerArguments(arguments->server); })
      .Writes();
}

void AddSyncCommand(Application* application, TransferBody<SyncArguments> body) {
  auto arguments = std::make_shared<SyncArguments>();
  Command& command = application->AddCommand(
      "sync",
      "Hand in what `serve` leaves and bring it maps, beside it",
      [arguments, body = std::move(body)](Context& context) { return body(*arguments, context); });
  AddServerOptions(&arguments->server, &command);
  command.Option("--state-dir", &arguments->state_dir, "Folder of reports and logs of `serve`")
      .Option("--outbox", &arguments->outbox, "Folder for what became of each file")
      .Option("--outbox-quota-mib",
              &arguments->outbox_quota_mib,
              "Reports and logs may take this much; beyond it the oldest are deleted")
      .InRange(1, 1 << 30)
      .Option("--map-source",
              &arguments->map_source,
              "Who decides on maps: server: this command; vda5050: fleet control; none: nobody")
      .OneOf({"none", "server", "vda5050"})
      .Option("--area", &arguments->area, "Area whose maps are brought")
      .Option("--maps", &arguments->maps, "Folder of maps of `serve`")
      .Option(
          "--maps-quota-mib", &arguments->maps_quota_mib, "The folder of maps may take this much")
      .InRange(1, 1 << 30)
      .Option(
          "--map-ca",
          &arguments->map_ca,
          "Authority of the servers that fleet control's links name, PEM; default: the system's")
      .Option("--socket", &arguments->socket, "Unix socket of `serve`")
      .Option("--snapshot-key",
              &arguments->snapshot_keys,
              "Ed25519 public key, PEM; a snapshot must be signed by one of those given")
      .Option("--poll-s", &arguments->poll_s, "Time between two looks for files")
      .InRange(0.01, 86'400.0)
      .Option("--map-poll-s",
              &arguments->map_poll_s,
              "Time between two looks for a map, where the server tells nothing")
      .InRange(0.01, 86'400.0)
      .Flag("--once", &arguments->once, "Hand in what waits, bring a map, and end")
      .Flag("--try-refused", &arguments->try_refused, "Hand in refused files again")
      .Check([arguments] { return CheckSync(*arguments); })
      .Writes();
}

}  // namespace shiftmap
