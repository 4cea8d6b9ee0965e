// SPDX-License-Identifier: Apache-2.0
//
// The end of a shift over bad links. The long form has 200 vehicles and writes figures:
//   SHIFTMAP_LONG_TESTS=1 SHIFTMAP_RESULTS=tests/results/fleet-links shiftmap_fleet_links_test
#include "tests/scenario/fleet_links.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <set>
#include <thread>

#include "localizer/transfer/hand_in.h"
#include "localizer/transfer/outbox.h"
#include "localizer/transfer/snapshot_fetch.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/map/sha256.h"
#include "mapstore/map_store.h"
#include "tests/support/cutting_proxy.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

bool LongForm() { return std::getenv("SHIFTMAP_LONG_TESTS") != nullptr; }

double SecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

// What one vehicle saw of the end of its shift.
struct Seen {
  bool done = false;
  std::set<std::string> acknowledged;  // Names of files.
  int lost_answers = 0;                // Reports that the server knew when they came again.
  int tries = 0;
  std::string error;
};

// What sync does, to its end.
Seen EndShift(const transfer::ServerOptions& server,
              const ShiftFiles& files,
              const std::string& output,
              std::atomic<int>* acknowledged) {
  Seen seen;
  transfer::OutboxOptions outbox_options;
  outbox_options.files = files.state.path();
  outbox_options.record = files.outbox.path();
  StatusOr<transfer::Outbox> outbox = transfer::Outbox::Open(outbox_options);
  if (!outbox.ok()) return seen;
  transfer::HandInOptions options;
  options.server = server;
  options.server.call_deadline_s = 10.0;
  options.piece_bytes = 16'384;
  options.inform = [&](const std::string& line) {
    ++*acknowledged;
    if (line.find("known already") != std::string::npos) ++seen.lost_answers;
  };
  transfer::HandIn hand_in(&*outbox, options);
  const transfer::BackoffOptions patience{.first_s = 0.1, .longest_s = 2.0, .give_up_s = 200.0};
  transfer::Backoff backoff(patience, transfer::RandomSeed());
  Status status = OkStatus();
  do {
    ++seen.tries;
    const auto before = hand_in.counts().reports + hand_in.counts().logs;
    status = hand_in.Pass({});
    if (hand_in.counts().reports + hand_in.counts().logs > before) backoff.Progress();
  } while (!status.ok() && backoff.Again(status, {}));
  for (const auto& [name, item] : outbox->items()) {
    if (item.state == transfer::OutboxState::kAcknowledged) seen.acknowledged.insert(name);
    if (item.state == transfer::OutboxState::kRefused) status = InvalidArgument("{}", item.reason);
  }
  transfer::FetchOptions fetch;
  fetch.area = "floor";
  fetch.output = output;
  fetch.backoff = patience;
  if (status.ok()) {
    StatusOr<transfer::MapClient> client = transfer::MapClient::Create(options.server);
    status = transfer::FetchSnapshot(&*client, fetch).status();
  }
  seen.done = status.ok();
  seen.error = Message(status);
  return seen;
}

class FleetLinksTest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { world_ = new FleetWorld(); }
  static void TearDownTestSuite() {
    delete world_;
    if (const char* const folder = std::getenv("SHIFTMAP_RESULTS"); folder != nullptr) {
      fs::create_directories(folder);
      WriteFile(std::string(folder) + "/fleet-links.json", JsonText(figures_));
    }
  }

  FleetLinksTest() { world_->CopyStore(folder_.File("maps.db")); }

  std::string Output(int vehicle) const { return folder_.File(fmt::format("{}.db", vehicle)); }

  // Runs `shifts` through so many vehicles at a time. @return seconds.
  double EndShifts(const transfer::ServerOptions& server,
                   const std::vector<std::unique_ptr<ShiftFiles>>& shifts,
                   int at_a_time,
                   std::vector<Seen>* seen,
                   std::atomic<int>* acknowledged) const {
    const Clock::time_point begin = Clock::now();
    seen->assign(shifts.size(), Seen());
    std::atomic<std::size_t> next{0};
    std::vector<std::jthread> vehicles;
    for (int i = 0; i < at_a_time; ++i) {
      vehicles.emplace_back([&] {
        for (std::size_t at = next++; at < shifts.size(); at = next++) {
          (*seen)[at] = EndShift(server, *shifts[at], Output(static_cast<int>(at)), acknowledged);
        }
      });
    }
    vehicles.clear();
    return SecondsSince(begin);
  }

  // Every report once in the ledger, every log whole, every snapshot one of the server's.
  void ExpectAllThere(const RestartedServer& server,
                      const std::vector<std::unique_ptr<ShiftFiles>>& shifts,
                      const std::vector<Seen>& seen) {
    StatusOr<MapStore> store = MapStore::Open(server.store(), MapStore::Access::kReadOnly);
    ASSERT_THAT(store, IsOk());
    const StatusOr<std::vector<ReportSummary>> reports = store->Reports("floor");
    ASSERT_THAT(reports, IsOk());
    std::map<std::string, int> times;
    for (const ReportSummary& report : *reports) ++times[report.uuid];
    EXPECT_EQ(reports->size(), shifts.size());
    for (std::size_t i = 0; i < shifts.size(); ++i) {
      const ShiftFiles& shift = *shifts[i];
      EXPECT_TRUE(seen[i].done) << shift.vehicle << ": " << seen[i].error;
      EXPECT_EQ(seen[i].acknowledged.size(), 2u) << shift.vehicle;
      EXPECT_EQ(times[shift.uuid], 1) << shift.vehicle;
      const std::string log = server.logs() + "/" + shift.vehicle + "/" + shift.uuid + ".mcap";
      ASSERT_TRUE(fs::exists(log)) << log;
      EXPECT_TRUE(ReadFile(log) == shift.log_bytes) << log;
      EXPECT_TRUE(fs::is_empty(shift.state.path())) << shift.vehicle;
      const StatusOr<std::string> sha256 = HashFile(Output(static_cast<int>(i)));
      ASSERT_THAT(sha256, IsOk());
      const std::string original = server.store() + ".snapshots/" + *sha256 + ".db";
      ASSERT_TRUE(fs::exists(original)) << original;
      EXPECT_TRUE(ReadFile(original) == ReadFile(Output(static_cast<int>(i)))) << shift.vehicle;
    }
    // One log of each, and no other.
    int logs = 0;
    for (const auto& entry : fs::recursive_directory_iterator(server.logs())) {
      if (entry.path().extension() == ".mcap") ++logs;
    }
    EXPECT_EQ(logs, static_cast<int>(shifts.size()));
  }

  std::vector<std::unique_ptr<ShiftFiles>> Shifts(int count, double log_s) const {
    std::vector<std::unique_ptr<ShiftFiles>> shifts;
    for (int i = 0; i < count; ++i) shifts.push_back(world_->Shift(i, log_s));
    return shifts;
  }

  static inline FleetWorld* world_ = nullptr;
  static inline Json figures_ = Json::object();
  TempDir folder_;
};

TEST_F(FleetLinksTest, OverCutLinksAndThroughKillsEveryReportCountsOnceAndEveryFileIsWhole) {
  const int vehicles = LongForm() ? 200 : 20;
  const int kills = LongForm() ? 10 : 2;
  RestartedServer server(folder_.File("maps.db"), folder_.File("logs"));
  server.WaitUntilItServes();
  CuttingProxy link(server.port(), {.probability = 0.6, .longest_bytes = 60'000, .seed = 5});
  const auto shifts = Shifts(vehicles, LongForm() ? 60.0 : 20.0);
  std::atomic<int> acknowledged{0};
  double peak_mib = 0.0;
  std::jthread killer([&](const std::stop_token& stop) {
    for (int kill = 1; kill <= kills; ++kill) {
      // Spread over the whole: of 2 files of each vehicle, a share is acknowledged.
      const int due = 2 * vehicles * kill / (kills + 1);
      while (acknowledged < due && transfer::SleepFor(0.005, stop)) continue;
      peak_mib = std::max(peak_mib, server.PeakMib());
      server.KillAndStart();
    }
  });
  std::vector<Seen> seen;
  const double took_s =
      EndShifts(server.ToServer(link.address()), shifts, vehicles, &seen, &acknowledged);
  killer.request_stop();
  killer.join();
  server.WaitUntilItServes();
  peak_mib = std::max(peak_mib, server.PeakMib());
  ExpectAllThere(server, shifts, seen);
  int lost_answers = 0;
  int tries = 0;
  for (const Seen& vehicle : seen) {
    lost_answers += vehicle.lost_answers;
    tries += vehicle.tries;
  }
  // The links were bad, and answers were lost after the server had committed. How many connections
  // there are depends on the time of the kills.
  EXPECT_GT(2 * link.cuts(), vehicles);
  EXPECT_GT(tries, vehicles);
  if (LongForm()) {
    EXPECT_GT(lost_answers, 0);
  }
  figures_["cut_links"] = {{"vehicles", vehicles},
                           {"kills", kills},
                           {"connections", link.connections()},
                           {"cuts", link.cuts()},
                           {"answers_lost_after_commit", lost_answers},
                           {"passes", tries},
                           {"took_s", took_s},
                           {"server_peak_mib", peak_mib}};
}

Json Quantiles(std::vector<double> values_s) {
  std::sort(values_s.begin(), values_s.end());
  const auto at = [&](double q) {
    const auto index = static_cast<std::size_t>(q * static_cast<double>(values_s.size() - 1));
    return 1e3 * values_s[index];
  };
  return {{"p50", at(0.5)}, {"p99", at(0.99)}, {"max", at(1.0)}};
}

// In the order of their arrival within a minute, each on a connection of its own.
TEST_F(FleetLinksTest, SubmitsOfAMinute) {
  if (!LongForm()) GTEST_SKIP() << "a measurement: SHIFTMAP_LONG_TESTS";
  constexpr int kVehicles = 200;
  constexpr double kMinuteS = 60.0;
  RestartedServer server(folder_.File("maps.db"), folder_.File("logs"));
  server.WaitUntilItServes();
  const auto shifts = Shifts(kVehicles, 60.0);
  std::mt19937_64 random(3);
  std::vector<double> latency_s(kVehicles);  // Until it is acknowledged.
  std::atomic<int> tries_again{0};
  std::atomic<int> acknowledged{0};
  std::vector<std::jthread> vehicles;
  for (int i = 0; i < kVehicles; ++i) {
    const double start_s = std::uniform_real_distribution<double>(0.0, kMinuteS)(random);
    vehicles.emplace_back([&, i, start_s] {
      transfer::SleepFor(start_s, {});
      const ShiftFiles& shift = *shifts[static_cast<std::size_t>(i)];
      const std::string report = ReadFile(shift.state.File(shift.uuid + ".report"));
      auto client = transfer::MapClient::Create(server.ToServer(server.address()));
      (void)client->GetSnapshot("floor");
      const Clock::time_point begin = Clock::now();
      transfer::Backoff backoff({.first_s = 0.1, .longest_s = 2.0}, transfer::RandomSeed());
      Status status = client->SubmitReport(report).status();
      while (!status.ok() && backoff.Again(status, {})) {
        ++tries_again;
        status = client->SubmitReport(report).status();
      }
      EXPECT_THAT(status, IsOk());
      latency_s[static_cast<std::size_t>(i)] = SecondsSince(begin);
      EndShift(server.ToServer(server.address()), shift, Output(i), &acknowledged);
    });
  }
  vehicles.clear();
  const double peak_mib = server.PeakMib();
  // The same reports, straight into a store on the same disk.
  world_->CopyStore(folder_.File("raw.db"));
  StatusOr<MapStore> raw = MapStore::Open(folder_.File("raw.db"), MapStore::Access::kReadWrite);
  ASSERT_THAT(raw, IsOk());
  std::vector<double> raw_s;
  for (int i = 0; i < kVehicles; ++i) {
    const ShiftReport report = world_->Report(i);
    const Clock::time_point begin = Clock::now();
    ASSERT_THAT(raw->Return(report), IsOk());
    raw_s.push_back(SecondsSince(begin));
  }
  figures_["submit"] = {{"vehicles_in_a_minute", kVehicles},
                        {"evidence_rows", world_->Report(0).evidence.size()},
                        {"submit_ms", Quantiles(latency_s)},
                        {"tries_again", tries_again.load()},
                        {"raw_insert_ms", Quantiles(raw_s)},
                        {"server_peak_mib", peak_mib}};
}

TEST_F(FleetLinksTest, Saturation) {
  if (!LongForm()) GTEST_SKIP() << "a measurement: SHIFTMAP_LONG_TESTS";
  constexpr int kShifts = 150;
  Json list = Json::array();
  for (const int at_a_time : {1, 4, 16, 64}) {
    const TempDir folder;
    world_->CopyStore(folder.File("maps.db"));
    RestartedServer server(folder.File("maps.db"), folder.File("logs"));
    server.WaitUntilItServes();
    const auto shifts = Shifts(kShifts, 60.0);
    std::vector<Seen> seen;
    std::atomic<int> acknowledged{0};
    const double cpu_before_s = server.CpuS();
    timespec own_before{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &own_before);
    const double took_s =
        EndShifts(server.ToServer(server.address()), shifts, at_a_time, &seen, &acknowledged);
    timespec own{};
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &own);
    const auto own_s = static_cast<double>(own.tv_sec - own_before.tv_sec) +
                       1e-9 * static_cast<double>(own.tv_nsec - own_before.tv_nsec);
    for (const Seen& vehicle : seen) EXPECT_TRUE(vehicle.done) << vehicle.error;
    list.push_back({{"at_a_time", at_a_time},
                    {"vehicles_per_min", 60.0 * kShifts / took_s},
                    {"server_cpu_s_per_vehicle", (server.CpuS() - cpu_before_s) / kShifts},
                    {"vehicles_cpu_s_per_vehicle", own_s / kShifts},
                    {"log_bytes", shifts.front()->log_bytes.size()},
                    {"server_peak_mib", server.PeakMib()}});
    for (int i = 0; i < kShifts; ++i) fs::remove(Output(i));
  }
  figures_["saturation"] = list;
}

}  // namespace
}  // namespace shiftmap::testing
