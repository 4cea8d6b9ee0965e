// SPDX-License-Identifier: Apache-2.0
//
// Reads the input as a run log: as a whole file, or as messages that a sound file carries. A log
// that is accepted must survive writing unchanged.
#include "mapstore/codec/run_log.h"

#include <algorithm>
#include <iterator>
#include <optional>

#include "mapstore/codec/run_log_messages.h"
#include "mapstore/run/item_limits.h"
#include "proto/core/check.h"
#include "proto/mcap/writer.h"
#include "tests/fuzz/fuzz_file.h"
#include "tests/fuzz/fuzz_input.h"
#include "tests/fuzz/fuzz_target.h"

namespace shiftmap::testing {
namespace {

struct Topic {
  const char* topic;
  const char* schema;
};

constexpr Topic kTopics[] = {{"/run_info", "shiftmap.proto.RunInfo"},
                             {"/odometry", "shiftmap.proto.Odometry"},
                             {"/landmarks", "shiftmap.proto.LandmarkScan"},
                             {"/lidar", "shiftmap.proto.LidarScan"},
                             {"/odometry", "shiftmap.proto.RunInfo"},
                             {"/else", "shiftmap.proto.Odometry"}};

std::string Messages(FuzzInput input) {
  std::string bytes;
  mcap::Writer writer(
      [&](std::string_view more) {
        bytes += more;
        return OkStatus();
      },
      {.compression = mcap::Compression::kNone, .chunk_bytes = 1000});
  std::optional<std::uint16_t> channels[std::size(kTopics)];
  while (!input.empty()) {
    const std::size_t kind = input.Index(std::size(kTopics));
    const std::string_view message = input.TakeBytes(input.Take(1));
    if (!channels[kind]) {
      channels[kind] = writer.AddChannel(
          writer.AddSchema(kTopics[kind].schema, "protobuf", ""), kTopics[kind].topic, "protobuf");
    }
    writer.Write(*channels[kind], 0, message).IgnoreError();
  }
  writer.Finish().IgnoreError();
  return bytes;
}

std::string FileOf(const Run& run, bool compress) {
  const std::string path = FuzzFile("");
  const Status written = WriteRunLog(run, path, {.compress = compress, .chunk_bytes = 300});
  SHIFTMAP_CHECK(written.ok(), "{}", Message(written));
  return ReadFile(path);
}

// All numbers alike, as far as they may be.
Run SeedRun(double number) {
  const Stamp begin = StampFromSeconds(1.0e9);
  Run run;
  run.info = {"truck", "fuzz"};
  run.odometry = {{begin, number, -number}, {begin, -number, number}, {begin, 0.0, 0.0}};
  run.odometry.back().stamp = StampFromSeconds(4.6e9);
  const Eigen::Matrix2d covariance = Eigen::Matrix2d::Identity() * number;
  using Kind = Observation::Kind;
  run.scans = {Scan{begin,
                    {{Signature("17"), Kind::kRangeBearing, {number, number}, std::nullopt},
                     {Signature(), Kind::kCartesian, {-number, number}, std::nullopt},
                     {Signature("17"), Kind::kCartesian, {number, number}, covariance}}},
               Scan{begin, {}}};
  const auto range = static_cast<float>(std::min(number, LidarSensor::kMaxRangeM));
  run.lidar_scans = {{begin, {}, {range, 0.0f, range}},
                     {begin,
                      {.field_of_view_rad = 6.28,
                       .max_range_m = range,
                       .T_vehicle_lidar = Se2(number, -number, number)},
                      {0.0f, 0.0f}}};
  return run;
}

}  // namespace

std::vector<std::string> FuzzSeeds() {
  std::vector<std::string> seeds = {std::string(1, '\0')};
  const auto message = [](int kind, const std::string& bytes) {
    return std::string{static_cast<char>(kind), static_cast<char>(bytes.size())} + bytes;
  };
  for (const double number : {1.0, 1e-9, 1e9}) {
    const Run run = SeedRun(number);
    for (const bool compress : {false, true}) seeds.push_back('\0' + FileOf(run, compress));
    std::string messages = '\1' + message(0, EncodeRunInfo(run.info));
    for (const OdometrySample& sample : run.odometry)
      messages += message(1, EncodeOdometry(sample));
    for (const Scan& scan : run.scans) messages += message(2, EncodeScan(scan));
    for (const LidarScan& scan : run.lidar_scans) messages += message(3, EncodeLidarScan(scan));
    seeds.push_back(messages);
  }
  return seeds;
}

void RunFuzzInput(std::string_view bytes) {
  FuzzInput input(bytes);
  const bool messages = input.Take(1) % 2 == 1;
  const std::string file(messages ? Messages(input) : std::string(input.rest()));
  StatusOr<RunLog> log = ReadRunLog(FuzzFile(file));
  if (!log.ok()) return;
  const Status valid = ValidateRun(log->run);
  SHIFTMAP_CHECK(valid.ok(), "an invalid run was read: {}", Message(valid));
  const std::string written = FileOf(log->run, false);
  const StatusOr<RunLog> again = ReadRunLog(FuzzFile(written));
  SHIFTMAP_CHECK(again.ok(), "{}", Message(again.status()));
  SHIFTMAP_CHECK(FileOf(again->run, false) == written, "another run was written");
  DropImplausible(ItemLimits(), &log->run);
  for (const Scan& scan : log->run.scans) {
    for (const Observation& observation : scan.observations) {
      SHIFTMAP_CHECK(observation.PositionInVehicle().allFinite(), "a position is not finite");
    }
  }
}

}  // namespace shiftmap::testing
