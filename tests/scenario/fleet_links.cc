// SPDX-License-Identifier: Apache-2.0
#include "tests/scenario/fleet_links.h"

#include <arpa/inet.h>
#include <fmt/format.h>
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>
#include <utility>

#include "mapstore/codec/run_log.h"
#include "mapstore/codec/shift_report.h"
#include "mapstore/core/owned_fd.h"
#include "proto/core/check.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

int FreePort() {
  const OwnedFd fd(socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof address;
  auto* const generic = reinterpret_cast<sockaddr*>(&address);
  SHIFTMAP_CHECK(bind(fd.get(), generic, length) == 0, "no port");
  SHIFTMAP_CHECK(getsockname(fd.get(), generic, &length) == 0, "no name");
  return ntohs(address.sin_port);
}

}  // namespace

RestartedServer::RestartedServer(std::string store, std::string logs)
    : store_(std::move(store)), logs_(std::move(logs)), port_(FreePort()) {
  Start();
}

transfer::ServerOptions RestartedServer::ToServer(const std::string& at) const {
  transfer::ServerOptions options;
  options.address = at;
  options.development_plain_text = true;
  return options;
}

void RestartedServer::Start() {
  const Arguments arguments = {"--store",
                               store_,
                               "--listen",
                               address(),
                               "--development-plain-text",
                               "--logs",
                               logs_,
                               "--snapshot-interval-s",
                               "5",
                               "--keep-free-mib",
                               "0",
                               // In plain text all are one client.
                               "--calls-per-s",
                               "100000",
                               "--max-transfers",
                               "1024",
                               "--max-streams-per-client",
                               "1024",
                               "--log-level",
                               "error"};
  process_ = std::make_unique<BackgroundCommand>("shiftmap-server", arguments);
}

void RestartedServer::KillAndStart() {
  const std::lock_guard lock(mutex_);
  process_->End(SIGKILL);
  Start();
}

void RestartedServer::WaitUntilItServes() const {
  StatusOr<transfer::MapClient> client = transfer::MapClient::Create(ToServer(address()));
  SHIFTMAP_CHECK(client.ok(), "{}", Message(client.status()));
  constexpr int kTries = 400;
  for (int i = 0; i < kTries * kSlowdown; ++i) {
    if (client->GetSnapshot("floor").ok()) return;
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
  }
  SHIFTMAP_CHECK(false, "no answer: {}", process_->Errors());
}

double RestartedServer::PeakMib() const {
  const std::lock_guard lock(mutex_);
  std::istringstream lines(ReadFile(fmt::format("/proc/{}/status", process_->pid())));
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("VmHWM:")) return std::stod(line.substr(6)) / 1024.0;
  }
  return 0.0;
}

double RestartedServer::CpuS() const {
  const std::lock_guard lock(mutex_);
  const std::string stat = ReadFile(fmt::format("/proc/{}/stat", process_->pid()));
  std::istringstream words(stat.substr(stat.rfind(')') + 2));
  std::string word;
  double ticks = 0.0;
  // utime and stime are the 14th and 15th fields, counted from 1; the third comes first here.
  for (int field = 3; words >> word && field <= 15; ++field) {
    if (field >= 14) ticks += std::stod(word);
  }
  return ticks / static_cast<double>(sysconf(_SC_CLK_TCK));
}

FleetWorld::FleetWorld()
    : world_({"--shifts", "3", "--seed", "11", "--groups", "14", "--size-m", "25"}) {
  RunForJson("shiftmap-mapper", world_.BuildOf("maps.db", {0, 1}));
  RunForJson("shiftmap-localizer",
             {"run",
              "--store",
              world_.File("maps.db"),
              "--area",
              "floor",
              "--report",
              world_.File("a.report"),
              world_.Log(2)});
  StatusOr<ShiftReport> report = ReadShiftReport(world_.File("a.report"));
  SHIFTMAP_CHECK(report.ok(), "{}", Message(report.status()));
  report_ = *std::move(report);
  StatusOr<RunLog> log = ReadRunLog(world_.Log(2));
  SHIFTMAP_CHECK(log.ok(), "{}", Message(log.status()));
  run_ = std::move(log->run);
}

void FleetWorld::CopyStore(const std::string& path) const {
  std::filesystem::copy_file(world_.File("maps.db"), path);
}

ShiftReport FleetWorld::Report(int vehicle) const {
  ShiftReport report = *report_;
  report.uuid = RandomUuid();
  report.run_uuid = report.uuid;
  report.run_hash.clear();
  report.vehicle = fmt::format("truck-{}", vehicle);
  return report;
}

std::unique_ptr<ShiftFiles> FleetWorld::Shift(int vehicle, double log_s) const {
  const ShiftReport report = Report(vehicle);
  auto files = std::make_unique<ShiftFiles>();
  files->uuid = report.uuid;
  files->vehicle = report.vehicle;
  EXPECT_THAT(WriteShiftReport(report, files->state.File(report.uuid + ".report")), IsOk());
  Run run = *run_;
  run.info.vehicle = report.vehicle;
  run.info.uuid = report.uuid;
  run.info.area = "floor";
  const Stamp end = run.odometry.front().stamp + FromSeconds(log_s);
  std::erase_if(run.odometry, [&](const OdometrySample& sample) { return sample.stamp > end; });
  std::erase_if(run.scans, [&](const Scan& scan) { return scan.stamp > end; });
  const std::string log = files->state.File(report.uuid + ".mcap");
  EXPECT_THAT(WriteRunLog(run, log), IsOk());
  files->log_bytes = ReadFile(log);
  return files;
}

}  // namespace shiftmap::testing
