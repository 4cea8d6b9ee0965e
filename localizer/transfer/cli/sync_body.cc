// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <string>

#include "localizer/transfer/cli/transfer_bodies.h"
#include "localizer/transfer/download_worker.h"
#include "localizer/transfer/sync_service.h"
#include "mapstore/core/blocked_signals.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/folder.h"
#include "mapstore/core/inert_text.h"
#include "mapstore/core/service_notifier.h"

namespace shiftmap::transfer {
namespace {

SyncOptions SyncOptionsOf(const SyncArguments& arguments, const Context& context) {
  SyncOptions options;
  options.hand_in.server = ServerOptionsOf(arguments.server);
  options.hand_in.max_bytes_per_s = 1024.0 * arguments.server.max_kib_per_s;
  options.hand_in.warn = [&context](const std::string& line) { context.Warn(line); };
  options.hand_in.inform = [&context](const std::string& line) { context.Inform(line); };
  options.poll_s = arguments.poll_s;
  options.map_poll_s = arguments.map_poll_s;
  options.backoff.longest_s = 60.0;
  return options;
}

MapSupplyOptions MapSupplyOptionsOf(const SyncArguments& arguments, const Context& context) {
  MapSupplyOptions options;
  options.server = ServerOptionsOf(arguments.server);
  options.area = arguments.area;
  options.maps = arguments.maps;
  options.spool = arguments.outbox;
  options.socket = arguments.socket;
  options.keys = arguments.snapshot_keys;
  options.folder.max_bytes = arguments.maps_quota_mib << 20;
  options.max_bytes_per_s = 1024.0 * arguments.server.max_kib_per_s;
  options.inform = [&context](const std::string& line) { context.Inform(line); };
  return options;
}

DownloadWorkerOptions DownloadWorkerOptionsOf(const SyncArguments& arguments,
                                              const Context& context) {
  DownloadWorkerOptions options;
  options.socket = arguments.socket;
  options.maps = arguments.maps;
  options.folder.max_bytes = arguments.maps_quota_mib << 20;
  options.download.ca = arguments.map_ca;
  options.download.max_bytes = options.folder.max_bytes;
  options.download.max_bytes_per_s = 1024.0 * arguments.server.max_kib_per_s;
  options.backoff.give_up_s = arguments.server.give_up_s;
  options.warn = [&context](const std::string& line) { context.Warn(line); };
  options.inform = [&context](const std::string& line) { context.Inform(line); };
  return options;
}

void Report(const Outbox& outbox, Context* context) {
  std::int64_t counts[4] = {};
  Json refused = Json::array();
  for (const auto& [name, item] : outbox.items()) {
    ++counts[static_cast<int>(item.state)];
    if (item.state == OutboxState::kRefused) {
      refused.push_back({{"name", name}, {"reason", item.reason}});
    }
  }
  Json document;
  std::string text;
  for (const OutboxState state : {OutboxState::kWaiting,
                                  OutboxState::kAcknowledged,
                                  OutboxState::kRefused,
                                  OutboxState::kLost}) {
    document[ToString(state)] = counts[static_cast<int>(state)];
    text += fmt::format("{} {}\n", counts[static_cast<int>(state)], ToString(state));
  }
  document["refusals"] = refused;
  context->Report(document, text);
}

// One round of everything.
Status Once(const SyncArguments& arguments,
            const SyncOptions& options,
            Outbox* outbox,
            Context* context) {
  HandIn hand_in(outbox, options.hand_in);
  Backoff backoff({.give_up_s = arguments.server.give_up_s}, RandomSeed());
  Status status = OkStatus();
  do {
    status = hand_in.Pass({});
  } while (!status.ok() && backoff.Again(status, {}));
  bool map_came = false;
  if (status.ok() && arguments.map_source == "server") {
    MapSupply supply(MapSupplyOptionsOf(arguments, *context));
    status = supply.Fetch({});
    map_came = supply.waits();
    if (status.ok()) status = supply.Enable();
  }
  Report(*outbox, context);
  SHIFTMAP_RETURN_IF_ERROR(status);
  const HandInCounts& counts = hand_in.counts();
  const auto refused =
      std::count_if(outbox->items().begin(), outbox->items().end(), [](const auto& each) {
        return each.second.state == OutboxState::kRefused;
      });
  if (refused > 0) {
    context->Attend(fmt::format("outbox '{}': {} refused; --try-refused hands them in again",
                                arguments.outbox,
                                CountText(refused, "file")));
  } else if (counts.reports + counts.logs == 0 && !map_came) {
    return MakeStatus(StatusCode::kAlreadyExists,
                      "server '{}': it has every file, and there is no newer map",
                      arguments.server.server);
  }
  return OkStatus();
}

}  // namespace

Status RunSync(const SyncArguments& arguments, Context& context) {
  ServiceNotifier notifier;
  if (context.dry_run()) return CheckFolder(arguments.outbox);
  SHIFTMAP_RETURN_IF_ERROR(MakeFolder(arguments.outbox));
  const SyncOptions options = SyncOptionsOf(arguments, context);
  OutboxOptions outbox_options;
  outbox_options.files = arguments.state_dir;
  outbox_options.record = arguments.outbox;
  outbox_options.max_bytes = arguments.outbox_quota_mib << 20;
  outbox_options.warn = options.hand_in.warn;
  SHIFTMAP_ASSIGN_OR_RETURN(Outbox outbox, Outbox::Open(outbox_options));
  if (arguments.try_refused) SHIFTMAP_RETURN_IF_ERROR(outbox.ForgetRefusals());
  StandBack();
  if (arguments.once) return Once(arguments, options, &outbox, &context);

  const BlockedSignals signals;  // Before the first thread is made.
  Workers workers;
  if (!arguments.server.server.empty()) workers.Start(HandInWorker(&outbox, options));
  if (arguments.map_source == "vda5050") {
    workers.Start(DownloadWorker(DownloadWorkerOptionsOf(arguments, context)));
  }
  if (arguments.map_source == "server") {
    workers.Start(MapWorker(MapSupplyOptionsOf(arguments, context), options));
  }
  notifier.Ready();
  while (!signals.WaitFor(std::chrono::seconds(1))) {
    if (workers.Alive()) notifier.Alive();
  }
  notifier.Stopping();
  workers.Stop();
  Report(outbox, &context);
  return OkStatus();
}

}  // namespace shiftmap::transfer
