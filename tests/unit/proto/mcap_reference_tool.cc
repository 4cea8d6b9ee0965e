// SPDX-License-Identifier: Apache-2.0
//
// Our side of the test against MCAP's reference implementation (mcap_reference_test.sh):
//   write FILE zstd|none   writes a run of known content
//   print FILE             prints a run log, a line per item, numbers bit by bit
#include <bit>
#include <cmath>
#include <cstdio>
#include <string>

#include "mapstore/codec/run_log.h"

namespace shiftmap {
namespace {

Run KnownRun() {
  Run run;
  run.info = {"vehicle é", "mcap reference test"};
  const std::int64_t begin_ns = 1'248'272'272'841'000'000;
  for (int i = 0; i < 5000; ++i) {
    const Stamp stamp = StampFromNanoseconds(begin_ns + i * std::int64_t{20'000'001});
    run.odometry.push_back({stamp, 0.1 * std::sin(i / 100.0), -0.01 * i});
    if (i % 5 != 0) continue;
    Scan scan{stamp, {}};
    for (int k = 0; k < i % 4; ++k) {
      Observation observation;
      observation.signature = Signature(k == 2 ? "" : std::to_string(k + 10));
      observation.kind = k == 1 ? Observation::Kind::kCartesian : Observation::Kind::kRangeBearing;
      observation.z = {1.0 + k, -0.3 * k};
      if (k == 1) observation.cov_z = Eigen::Vector2d(0.25, 0.5).asDiagonal();
      scan.observations.push_back(observation);
    }
    run.scans.push_back(std::move(scan));
    if (i % 20 != 0) continue;
    LidarScan& lidar = run.lidar_scans.emplace_back();
    lidar.stamp = stamp;
    lidar.sensor.T_vehicle_lidar = Se2(0.1, -0.2, 0.3);
    for (int k = 0; k < 50; ++k) lidar.ranges_m.push_back(static_cast<float>(7 * k % 11));
  }
  return run;
}

std::string Bits(double value) {
  return fmt::format("{:016x}", std::bit_cast<std::uint64_t>(value));
}

void Print(const RunEvent& event) {
  fmt::print("{} ", ToNanoseconds(StampOf(event)));
  if (const auto* sample = std::get_if<OdometrySample>(&event)) {
    fmt::print("odometry {} {}\n", Bits(sample->v_mps), Bits(sample->omega_radps));
    return;
  }
  if (const auto* lidar = std::get_if<LidarScan>(&event)) {
    const LidarSensor& sensor = lidar->sensor;
    fmt::print("lidar {} {} {} {} {}",
               Bits(sensor.field_of_view_rad),
               Bits(sensor.max_range_m),
               Bits(sensor.T_vehicle_lidar.x()),
               Bits(sensor.T_vehicle_lidar.y()),
               Bits(sensor.T_vehicle_lidar.yaw()));
    for (const float range_m : lidar->ranges_m) fmt::print(" {}", std::lround(1000.0 * range_m));
    fmt::print("\n");
    return;
  }
  fmt::print("scan");
  for (const Observation& observation : std::get<Scan>(event).observations) {
    const bool polar = observation.kind == Observation::Kind::kRangeBearing;
    fmt::print(" [{}] {} {} {}",
               observation.signature.text(),
               polar ? "polar" : "cartesian",
               Bits(observation.z.x()),
               Bits(observation.z.y()));
    if (observation.cov_z) {
      const Eigen::Matrix2d& cov = *observation.cov_z;
      fmt::print(" {} {} {}", Bits(cov(0, 0)), Bits(cov(0, 1)), Bits(cov(1, 1)));
    }
  }
  fmt::print("\n");
}

Status PrintFile(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(RunLogStream stream, RunLogStream::Open(path));
  for (bool first = true;; first = false) {
    SHIFTMAP_ASSIGN_OR_RETURN(const std::optional<RunEvent> event, stream.Next());
    if (first) fmt::print("info [{}] [{}]\n", stream.info().vehicle, stream.info().source);
    if (!event) break;
    Print(*event);
  }
  return stream.truncation().empty() ? OkStatus() : DataLoss("{}", stream.truncation());
}

Status Main(const std::vector<std::string>& args) {
  if (args.size() == 3 && args[0] == "write") {
    return WriteRunLog(KnownRun(), args[1], {.compress = args[2] == "zstd", .chunk_bytes = 50'000});
  }
  if (args.size() == 2 && args[0] == "print") return PrintFile(args[1]);
  return InvalidArgument("usage: write FILE zstd|none, or print FILE");
}

}  // namespace
}  // namespace shiftmap

int main(int argc, char** argv) {
  const shiftmap::Status status = shiftmap::Main(std::vector<std::string>(argv + 1, argv + argc));
  if (status.ok()) return 0;
  std::fputs((shiftmap::Message(status) + "\n").c_str(), stderr);
  return 1;
}
