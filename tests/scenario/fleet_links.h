// SPDX-License-Identifier: Apache-2.0
//
// A fleet whose shifts end in one minute, bad links, and a server that is killed meanwhile.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "localizer/transfer/map_client.h"
#include "mapstore/map/evidence.h"
#include "mapstore/run/run.h"
#include "tests/scenario/background_command.h"
#include "tests/scenario/world.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::testing {

/// shiftmap-server on a store, in plain text, which can be killed and started again on its port.
/// Threads: any.
class RestartedServer {
 public:
  RestartedServer(std::string store, std::string logs);

  int port() const { return port_; }
  std::string address() const { return "127.0.0.1:" + std::to_string(port_); }
  transfer::ServerOptions ToServer(const std::string& at) const;

  /// Ends it with SIGKILL and starts it again.
  void KillAndStart();

  /// Waits until it answers.
  void WaitUntilItServes() const;

  /// The most memory that it had since it was started last. [MiB]
  double PeakMib() const;

  /// Processor time since then. [s]
  double CpuS() const;

  const std::string& logs() const { return logs_; }
  const std::string& store() const { return store_; }

 private:
  void Start();

  std::string store_;
  std::string logs_;
  int port_;
  mutable std::mutex mutex_;
  std::unique_ptr<BackgroundCommand> process_;
};

/// What a shift leaves on a vehicle.
struct ShiftFiles {
  TempDir state;  ///< As serve's: `<uuid>.report`, `<uuid>.mcap`.
  TempDir outbox;
  std::string uuid;
  std::string vehicle;
  std::string log_bytes;
};

/// A map of area `floor`, and shifts on it.
class FleetWorld {
 public:
  FleetWorld();

  /// The store as it is before any report, in another file.
  void CopyStore(const std::string& path) const;

  /// A shift of a vehicle: a report of its own and a log of its own.
  /// @param log_s  Length of its log. [s]
  std::unique_ptr<ShiftFiles> Shift(int vehicle, double log_s) const;

  ShiftReport Report(int vehicle) const;

 private:
  World world_;
  std::optional<ShiftReport> report_;
  std::optional<Run> run_;
};

}  // namespace shiftmap::testing
