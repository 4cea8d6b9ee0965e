// SPDX-License-Identifier: Apache-2.0
//
// The commands that talk to the map server: their options, for both binaries. Only
// shiftmap-transfer has their bodies, so that shiftmap-localizer does not link gRPC.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "mapstore/cli/application.h"
#include "mapstore/core/clock.h"
#include "proto/core/status.h"

namespace shiftmap {

/// How the server is reached; as in the site file.
struct ServerArguments {
  std::string server;
  std::string tls_ca;
  std::string tls_cert;
  std::string tls_key;
  bool development_plain_text = false;
  double give_up_s = 120.0;    ///< [s]
  double max_kib_per_s = 0.0;  ///< 0: no limit. [KiB/s]
};

struct FetchArguments {
  ServerArguments server;
  std::string area;
  std::string output;
  std::vector<std::string> snapshot_keys;
};

struct UploadArguments {
  ServerArguments server;
  std::vector<std::string> logs;
};

/// Either a store or a server.
struct ReturnArguments {
  std::string store;
  double clock_tolerance_s = kDefaultClockToleranceS;  ///< Of the store. [s]
  ServerArguments server;
  std::vector<std::string> reports;
};

struct SyncArguments {
  ServerArguments server;
  std::string state_dir = "/var/lib/shiftmap-localizer";
  std::string outbox = "/var/lib/shiftmap-transfer";
  std::int64_t outbox_quota_mib = 3072;
  std::string map_source = "none";
  std::string area;
  std::string maps = "/var/lib/shiftmap-maps";
  std::int64_t maps_quota_mib = 2048;
  std::string map_ca;
  std::string socket;
  std::vector<std::string> snapshot_keys;
  double poll_s = 10.0;
  double map_poll_s = 300.0;
  bool once = false;
  bool try_refused = false;
};

template <typename Arguments>
using TransferBody = std::function<Status(const Arguments&, Context&)>;

/// Adds `--server` and the options that go with it.
void AddServerOptions(ServerArguments* arguments, Command* command);

/// The message of a usage error, or nothing.
std::string CheckServerArguments(const ServerArguments& arguments);

void AddFetchCommand(Application* application, TransferBody<FetchArguments> body);
void AddReturnCommand(Application* application, TransferBody<ReturnArguments> body);
void AddUploadCommand(Application* application, TransferBody<UploadArguments> body);
void AddSyncCommand(Application* application, TransferBody<SyncArguments> body);

}  // namespace shiftmap
