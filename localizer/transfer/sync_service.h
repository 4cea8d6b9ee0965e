// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "localizer/transfer/backoff.h"
#include "localizer/transfer/hand_in.h"
#include "localizer/transfer/map_supply.h"
#include "localizer/transfer/outbox.h"
#include "localizer/transfer/wakeup.h"
#include "proto/core/status.h"

namespace shiftmap::transfer {

/// A sign of life of one worker, for the watchdog. Threads: any.
class Pulse {
 public:
  void Beat() { beat_ = Clock::now().time_since_epoch().count(); }
  double SecondsSince() const {
    const Clock::duration since = Clock::now().time_since_epoch() - Clock::duration(beat_.load());
    return std::chrono::duration<double>(since).count();
  }

 private:
  using Clock = std::chrono::steady_clock;
  std::atomic<Clock::rep> beat_{Clock::now().time_since_epoch().count()};
};

/// Threads that work beside each other until they are told to stop.
class Workers {
 public:
  /// A worker returns soon after a request to stop, and beats at least every kLongestSilenceS.
  using Worker = std::function<void(const std::stop_token&, Pulse&)>;
  static constexpr double kLongestSilenceS = 900.0;

  void Start(Worker worker);

  /// True if all beat.
  bool Alive() const;

  /// Requests all to stop and waits for them.
  void Stop();

 private:
  std::vector<std::unique_ptr<Pulse>> pulses_;
  std::vector<std::jthread> threads_;
};

struct SyncOptions {
  HandInOptions hand_in;
  double poll_s = 10.0;       ///< Between two looks for files. [s]
  double map_poll_s = 300.0;  ///< Between two looks for a map, where the server tells nothing. [s]
  BackoffOptions backoff;     ///< Its give_up_s does not count.
};

/// Hands in what waits, again and again.
/// @param outbox  Outlives the worker.
Workers::Worker HandInWorker(Outbox* outbox, SyncOptions options);

/// Fetches each map that the server publishes, and has `serve` take it between shifts. The server
/// tells of it by a stream; without one it is asked.
Workers::Worker MapWorker(MapSupplyOptions supply, SyncOptions options);

/// Lowers this thread's claim on processor and disk, and that of the threads it starts: what drives
/// goes first.
void StandBack();

}  // namespace shiftmap::transfer
