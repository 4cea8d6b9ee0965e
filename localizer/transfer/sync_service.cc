// SPDX-License-Identifier: Apache-2.0
#include "localizer/transfer/sync_service.h"

#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

namespace shiftmap::transfer {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kLookForEndOfShiftS = 2.0;

Clock::time_point After(double seconds) {
  return Clock::now() +
         std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(seconds));
}

// ioprio_set(2) has no wrapper.
constexpr int kIoprioWhoProcess = 1;
constexpr int kIoprioIdle = 3 << 13;
constexpr int kLowestPriority = 19;

// Says a line once, and not again until another one or `Clear` came.
class Changes {
 public:
  explicit Changes(std::function<void(const std::string&)> say) : say_(std::move(say)) {}
  void Say(const std::string& line) {
    if (line != last_ && say_) say_(line);
    last_ = line;
  }
  void Clear() { last_.clear(); }

 private:
  std::function<void(const std::string&)> say_;
  std::string last_;
};

// Tells of new snapshots as long as the server does.
void Watch(const MapSupplyOptions& supply,
           const SyncOptions& options,
           Wakeup* published,
           const std::stop_token& stop,
           Pulse& pulse) {
  Backoff backoff(options.backoff, RandomSeed());
  while (!stop.stop_requested()) {
    pulse.Beat();
    StatusOr<MapClient> client = MapClient::Create(supply.server, stop);
    Status status = client.status();
    if (status.ok()) {
      status = client->WatchSnapshots(supply.area, [&](const SnapshotInfo&) {
        backoff.Progress();
        published->Notify();
      });
    }
    // Without the stream the map is polled for.
    if (!SleepFor(status.ok() ? 0.0 : backoff.NextDelayS(), stop)) return;
  }
}

}  // namespace

void Workers::Start(Worker worker) {
  pulses_.push_back(std::make_unique<Pulse>());
  threads_.emplace_back([worker = std::move(worker), pulse = pulses_.back().get()](
                            const std::stop_token& stop) { worker(stop, *pulse); });
}

bool Workers::Alive() const {
  return std::all_of(pulses_.begin(), pulses_.end(), [](const std::unique_ptr<Pulse>& pulse) {
    return pulse->SecondsSince() < kLongestSilenceS;
  });
}

void Workers::Stop() {
  for (std::jthread& thread : threads_) thread.request_stop();
  threads_.clear();
}

Workers::Worker HandInWorker(Outbox* outbox, SyncOptions options) {
  return [outbox, options = std::move(options)](const std::stop_token& stop, Pulse& pulse) {
    HandInOptions hand_in_options = options.hand_in;
    hand_in_options.alive = [&pulse] { pulse.Beat(); };
    HandIn hand_in(outbox, hand_in_options);
    Backoff backoff(options.backoff, RandomSeed());
    Changes trouble(options.hand_in.warn);
    while (!stop.stop_requested()) {
      pulse.Beat();
      const HandInCounts before = hand_in.counts();
      const Status status = hand_in.Pass(stop);
      const HandInCounts& now = hand_in.counts();
      if (now.reports > before.reports || now.log_bytes > before.log_bytes) backoff.Progress();
      if (status.ok()) {
        trouble.Clear();
        SleepFor(options.poll_s, stop);
      } else if (status.code() != StatusCode::kCancelled) {
        trouble.Say(Message(status));
        SleepFor(IsTemporary(status) ? backoff.NextDelayS() : options.map_poll_s, stop);
      }
    }
  };
}

Workers::Worker MapWorker(MapSupplyOptions supply_options, SyncOptions options) {
  return [supply_options = std::move(supply_options), options = std::move(options)](
             const std::stop_token& stop, Pulse& pulse) mutable {
    Wakeup published;
    Pulse watch_pulse;
    const std::jthread watch([&](const std::stop_token& watch_stop) {
      Watch(supply_options, options, &published, watch_stop, watch_pulse);
    });
    supply_options.alive = [&pulse] { pulse.Beat(); };
    MapSupply supply(supply_options);
    Backoff backoff(options.backoff, RandomSeed());
    Changes trouble(options.hand_in.warn);
    auto fetch_at = Clock::now();
    while (!stop.stop_requested()) {
      if (watch_pulse.SecondsSince() < Workers::kLongestSilenceS) pulse.Beat();
      if (Clock::now() >= fetch_at) {
        const Status fetched = supply.Fetch(stop);
        if (fetched.ok()) {
          backoff.Progress();
          trouble.Clear();
        } else if (fetched.code() != StatusCode::kCancelled) {
          trouble.Say(Message(fetched));
        }
        fetch_at = After(IsTemporary(fetched) ? backoff.NextDelayS() : options.map_poll_s);
      }
      const Status enabled = supply.Enable();
      if (!enabled.ok() && !IsTemporary(enabled)) trouble.Say(Message(enabled));
      const std::chrono::duration<double> left = fetch_at - Clock::now();
      const double wait_s =
          supply.waits() ? std::min(left.count(), kLookForEndOfShiftS) : left.count();
      if (published.WaitFor(wait_s, stop)) fetch_at = Clock::now();
    }
  };
}

void StandBack() {
  setpriority(PRIO_PROCESS, 0, kLowestPriority);
  syscall(SYS_ioprio_set, kIoprioWhoProcess, 0, kIoprioIdle);
}

}  // namespace shiftmap::transfer
