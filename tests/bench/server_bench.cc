// SPDX-License-Identifier: Apache-2.0
//
// How long a vehicle waits until its report is durable on the server, beside the store alone and
// plain SQLite doing the same inserts, in one run. Counters: quantiles of one report [ms].
#include <benchmark/benchmark.h>
#include <grpcpp/grpcpp.h>

#include <algorithm>
#include <atomic>
#include <iostream>
#include <memory>
#include <thread>
#include <vector>

#include "mapstore/codec/shift_report.h"
#include "mapstore/core/quantile.h"
#include "mapstore/server/map_server.h"
#include "proto/map_server.grpc.pb.h"
#include "tests/bench/plain_sqlite.h"
#include "tests/bench/store_world.h"

namespace shiftmap::testing {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kVisits = 100;

double MillisecondsSince(Clock::time_point begin) {
  return std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
}

void SetQuantiles(const std::vector<double>& times_ms, benchmark::State& state) {
  state.counters["p50_ms"] = Quantile(times_ms, 0.5);
  state.counters["p99_ms"] = Quantile(times_ms, 0.99);
  state.counters["max_ms"] = *std::max_element(times_ms.begin(), times_ms.end());
}

template <typename Write>
void TimeEach(World& world, benchmark::State& state, const Write& write) {
  std::vector<double> times_ms;
  for (auto _ : state) {
    state.PauseTiming();
    const ShiftReport report = world.Report(kVisits);
    state.ResumeTiming();
    const Clock::time_point begin = Clock::now();
    write(report);
    times_ms.push_back(MillisecondsSince(begin));
  }
  SetQuantiles(times_ms, state);
}

void BM_RawInserts(benchmark::State& state) {
  World world(1000);
  PlainSqlite plain(world.dir.File("plain.db"));
  TimeEach(world, state, [&](const ShiftReport& report) { plain.Insert(report, world.reports); });
}
BENCHMARK(BM_RawInserts)->Unit(benchmark::kMillisecond);

void BM_StoreReturn(benchmark::State& state) {
  World world(1000);
  TimeEach(world, state, [&](const ShiftReport& report) { world.Return(report); });
}
BENCHMARK(BM_StoreReturn)->Unit(benchmark::kMillisecond);

std::unique_ptr<server::MapServer> StartServer(const World& world, server::JsonLog* log) {
  server::MapServerOptions options;
  options.store = world.dir.File("a.db");
  options.snapshots = world.dir.File("snapshots");
  options.listen = {"127.0.0.1", 0};
  options.calls_per_s = 1e6;
  StatusOr<std::unique_ptr<server::MapServer>> started = server::MapServer::Start(options, log);
  SHIFTMAP_CHECK(started.ok(), "{}", Message(started.status()));
  return *std::move(started);
}

// So many vehicles, each on a connection of its own, submit a report at the same time, again and
// again. An iteration is one report of each.
void BM_Submit(benchmark::State& state) {
  const auto vehicles = static_cast<std::size_t>(state.range(0));
  World world(1000);
  server::JsonLog log(&std::cerr, server::JsonLog::Level::kWarning);
  const auto map_server = StartServer(world, &log);
  std::vector<std::unique_ptr<proto::MapServer::Stub>> stubs;
  for (std::size_t i = 0; i < vehicles; ++i) {
    grpc::ChannelArguments own;
    own.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
    stubs.push_back(proto::MapServer::NewStub(grpc::CreateCustomChannel(
        map_server->address().Text(), grpc::InsecureChannelCredentials(), own)));
  }
  std::vector<double> times_ms;
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<proto::SubmitReportRequest> requests(vehicles);
    for (proto::SubmitReportRequest& request : requests) {
      request.mutable_report()->ParseFromString(EncodeShiftReport(world.Report(kVisits)));
    }
    std::vector<double> round_ms(vehicles);
    std::vector<std::thread> threads;
    state.ResumeTiming();
    for (std::size_t i = 0; i < vehicles; ++i) {
      threads.emplace_back([&, i] {
        grpc::ClientContext context;
        proto::SubmitReportResponse response;
        const Clock::time_point begin = Clock::now();
        const grpc::Status status = stubs[i]->SubmitReport(&context, requests[i], &response);
        SHIFTMAP_CHECK(status.ok(), "{}", status.error_message());
        round_ms[i] = MillisecondsSince(begin);
      });
    }
    for (std::thread& thread : threads) thread.join();
    times_ms.insert(times_ms.end(), round_ms.begin(), round_ms.end());
  }
  SetQuantiles(times_ms, state);
  state.SetItemsProcessed(state.iterations() * state.range(0));
}
BENCHMARK(BM_Submit)
    ->Arg(1)
    ->Arg(8)
    ->Arg(50)
    ->Arg(200)
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace shiftmap::testing
