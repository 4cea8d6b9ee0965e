// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/clock.h"
#include "mapstore/core/day.h"
#include "mapstore/http/listen_address.h"
#include "mapstore/server/json_log.h"
#include "mapstore/server/snapshot_keeper.h"
#include "mapstore/server/upload_spool.h"
#include "proto/core/status.h"

namespace shiftmap::server {

/// The files of mutual TLS, in PEM. Changes are loaded while the server runs; where files cannot be
/// read, the previous ones stay in use.
struct TlsFiles {
  std::string certificate;  ///< The server's, with the chain that clients need.
  std::string key;
  std::string client_authority;
  std::string revocations;  ///< CRLs; empty: none.
};

struct MapServerOptions {
  std::string store;
  double clock_tolerance_s = kDefaultClockToleranceS;  ///< As MapStore::OpenOptions. [s]
  ListenAddress listen;
  std::optional<TlsFiles> tls;  ///< Nothing: plain text, for development.

  std::string snapshots;                     ///< Folder.
  std::vector<std::string> signing_keys;     ///< SnapshotSigner::Read.
  double keep_snapshots_s = kSecondsPerDay;  ///< After another one took their place. [s]
  SnapshotKeeperOptions keeper;

  std::string logs;  ///< Folder; empty: no logs are taken.
  UploadLimits uploads;

  double calls_per_s = 20.0;                 ///< Of each client. [1/s]
  std::int64_t max_message_bytes = 8 << 20;  ///< Of a report.
  int max_transfers = 256;                   ///< Downloads and uploads at a time.
  int max_watches = 4096;                    ///< WatchSnapshots at a time.
  int max_streams_per_client = 4;            ///< Of each of the two kinds.

  std::optional<ListenAddress> metrics;
};

/// The map server: the service of proto/map_server.proto over a store, beside other processes that
/// use it. Threads: the thread that started it, but for health().
class MapServer {
 public:
  /// Listens and answers when it returns.
  /// @param log  Must outlive the server.
  /// Errors: as MapStore::Open, SnapshotFolder::Open, UploadSpool::Open, SnapshotSigner::Read,
  /// Revocations::Read, HttpListener::Start; kInvalidArgument if the files of TLS do not read;
  /// kUnavailable if it cannot listen.
  static StatusOr<std::unique_ptr<MapServer>> Start(const MapServerOptions& options, JsonLog* log);
  ~MapServer();
  MapServer(const MapServer&) = delete;
  MapServer& operator=(const MapServer&) = delete;

  /// With the port that it got.
  const ListenAddress& address() const;
  std::optional<ListenAddress> metrics_address() const;

  /// Calls that were answered.
  std::int64_t calls() const;

  /// Whether no part of it hangs.
  bool IsAlive() const;

  /// What is to be done now and then: call about once a second.
  void Tend();

  /// Takes no more calls, lets those in flight end until the grace is over, and writes what waits.
  void Stop(std::chrono::milliseconds grace);

 private:
  struct State;
  explicit MapServer(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace shiftmap::server
