// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/run_log.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <limits>
#include <random>

#include "mapstore/codec/run_log_messages.h"
#include "mapstore/map/sha256.h"
#include "proto/run_log.pb.h"
#include "tests/unit/proto/mcap_test_util.h"

namespace shiftmap {
namespace {

constexpr std::int64_t kBeginNs = 1'248'272'272'841'000'001;

// Ranges of whole millimetres, up to the largest that there may be.
LidarScan MakeLidarScan(Stamp stamp, std::mt19937_64* random) {
  LidarScan scan;
  scan.stamp = stamp;
  scan.sensor = {
      .field_of_view_rad = 4.7, .max_range_m = 30.1, .T_vehicle_lidar = {1.2, -0.3, 2.0}};
  for (std::size_t i = 2 + (*random)() % 400; i > 0; --i) {
    constexpr std::uint64_t kMostMm[] = {1, 3000, 10'000'001};
    const auto range_mm = static_cast<double>((*random)() % kMostMm[i % 3]);
    scan.ranges_m.push_back(static_cast<float>(range_mm / 1000.0));
  }
  return scan;
}

// A run with every kind of observation, at full precision.
Run MakeRun(int samples) {
  std::mt19937_64 random(30);
  std::normal_distribution<double> normal;
  Run run;
  run.info = {"truck 7", "simulated é", "0f8fad5b-d9cb-469f-a165-70867728950e", "level é"};
  for (int i = 0; i < samples; ++i) {
    const Stamp stamp = StampFromNanoseconds(kBeginNs + 10'000'003LL * i);
    run.odometry.push_back({stamp, normal(random), normal(random)});
    if (i % 3 != 0) continue;
    Scan scan{stamp + Duration(i % 2), {}};
    for (int k = 0; k < i % 5; ++k) {
      Observation observation;
      observation.signature = Signature(k == 3 ? "" : std::to_string(k));
      observation.kind =
          k % 2 == 0 ? Observation::Kind::kRangeBearing : Observation::Kind::kCartesian;
      observation.z = {std::abs(normal(random)) + 0.1, normal(random)};
      if (k < 2) {
        const Eigen::Matrix2d root = Eigen::Matrix2d::NullaryExpr([&] { return normal(random); });
        const Eigen::Matrix2d cov = root * root.transpose() + Eigen::Matrix2d::Identity();
        observation.cov_z = Eigen::Matrix2d(0.5 * (cov + cov.transpose()));
      }
      scan.observations.push_back(observation);
    }
    run.scans.push_back(std::move(scan));
    if (i % 6 == 0) run.lidar_scans.push_back(MakeLidarScan(stamp, &random));
  }
  return run;
}

void ExpectEqual(const Scan& got, const Scan& expected) {
  EXPECT_EQ(got.stamp, expected.stamp);
  ASSERT_EQ(got.observations.size(), expected.observations.size());
  for (std::size_t i = 0; i < got.observations.size(); ++i) {
    const Observation& a = got.observations[i];
    const Observation& b = expected.observations[i];
    EXPECT_EQ(a.signature, b.signature);
    EXPECT_EQ(a.kind, b.kind);
    EXPECT_EQ(a.z, b.z);
    EXPECT_EQ(a.cov_z, b.cov_z);
  }
}

void ExpectEqual(const LidarScan& got, const LidarScan& expected) {
  EXPECT_EQ(got.stamp, expected.stamp);
  EXPECT_EQ(got.sensor.field_of_view_rad, expected.sensor.field_of_view_rad);
  EXPECT_EQ(got.sensor.max_range_m, expected.sensor.max_range_m);
  const Se2& T = got.sensor.T_vehicle_lidar;
  EXPECT_EQ(T.translation(), expected.sensor.T_vehicle_lidar.translation());
  EXPECT_EQ(T.yaw(), expected.sensor.T_vehicle_lidar.yaw());
  EXPECT_EQ(got.ranges_m, expected.ranges_m);
}

// `got` is the first items of `expected`.
void ExpectPrefix(const Run& got, const Run& expected) {
  ASSERT_LE(got.odometry.size(), expected.odometry.size());
  for (std::size_t i = 0; i < got.odometry.size(); ++i) {
    EXPECT_EQ(got.odometry[i].stamp, expected.odometry[i].stamp);
    EXPECT_EQ(got.odometry[i].v_mps, expected.odometry[i].v_mps);
    EXPECT_EQ(got.odometry[i].omega_radps, expected.odometry[i].omega_radps);
  }
  ASSERT_LE(got.scans.size(), expected.scans.size());
  for (std::size_t i = 0; i < got.scans.size(); ++i) ExpectEqual(got.scans[i], expected.scans[i]);
  ASSERT_LE(got.lidar_scans.size(), expected.lidar_scans.size());
  for (std::size_t i = 0; i < got.lidar_scans.size(); ++i) {
    ExpectEqual(got.lidar_scans[i], expected.lidar_scans[i]);
  }
}

void ExpectEqual(const Run& got, const Run& expected) {
  EXPECT_EQ(got.info.vehicle, expected.info.vehicle);
  EXPECT_EQ(got.info.source, expected.info.source);
  EXPECT_EQ(got.info.uuid, expected.info.uuid);
  EXPECT_EQ(got.info.area, expected.info.area);
  EXPECT_EQ(got.odometry.size(), expected.odometry.size());
  EXPECT_EQ(got.scans.size(), expected.scans.size());
  EXPECT_EQ(got.lidar_scans.size(), expected.lidar_scans.size());
  ExpectPrefix(got, expected);
}

class RunLogTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (std::filesystem::temp_directory_path() / "shiftmap_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
    path_ = (folder_ / "run.mcap").string();
  }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  static std::string Bytes(const std::string& path) {
    std::ifstream file(path, std::ios::binary);
    return {std::istreambuf_iterator<char>(file), {}};
  }
  void Put(const std::string& bytes) const { std::ofstream(path_, std::ios::binary) << bytes; }

  // A file with one message on a topic, `count` times.
  void PutMessage(std::string_view topic,
                  std::string_view schema,
                  std::string_view encoding,
                  const std::string& data,
                  int count = 1) const {
    std::string bytes;
    mcap::Writer writer(
        [&bytes](std::string_view more) {
          bytes.append(more);
          return OkStatus();
        },
        {});
    const std::uint16_t schema_id = writer.AddSchema(schema, "protobuf", "");
    const std::uint16_t channel = writer.AddChannel(schema_id, topic, encoding);
    for (int i = 0; i < count; ++i) ASSERT_TRUE(writer.Write(channel, 1, data).ok());
    ASSERT_TRUE(writer.Finish().ok());
    Put(bytes);
  }

  void ExpectError(StatusCode code, const std::string& part) const {
    const Status status = ReadRunLog(path_).status();
    EXPECT_EQ(status.code(), code) << Message(status);
    EXPECT_TRUE(Message(status).starts_with("run log '" + path_ + "': ")) << Message(status);
    EXPECT_NE(Message(status).find(part), std::string::npos) << Message(status);
  }

  std::filesystem::path folder_;
  std::string path_;
};

TEST_F(RunLogTest, RoundTripsBitByBit) {
  const shiftmap::Run run = MakeRun(500);
  for (const bool compress : {true, false}) {
    for (const std::int64_t chunk_bytes :
         {std::int64_t{1}, std::int64_t{4096}, std::int64_t{1} << 20}) {
      ASSERT_TRUE(WriteRunLog(run, path_, {compress, chunk_bytes}).ok());
      const auto log = ReadRunLog(path_);
      ASSERT_TRUE(log.ok()) << Message(log.status());
      ExpectEqual(log->run, run);
      EXPECT_EQ(log->truncation, "");
      EXPECT_EQ(log->sha256, *HashFile(path_));
    }
  }
}

// As any topic that it does not need, and that an older reader does not know.
TEST_F(RunLogTest, AReaderMaySkipLidarScans) {
  shiftmap::Run run = MakeRun(100);
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  const auto without = ReadRunLog(path_, {.lidar_scans = false});
  ASSERT_TRUE(without.ok()) << Message(without.status());
  ASSERT_FALSE(run.lidar_scans.empty());
  run.lidar_scans.clear();
  ExpectEqual(without->run, run);
  // Not even looked at.
  PutMessage("/lidar", "shiftmap.proto.LidarScan", "protobuf", "\xff");
  EXPECT_NE(Message(ReadRunLog(path_, {.lidar_scans = false}).status()).find("no odometry"),
            std::string::npos);
}

TEST_F(RunLogTest, KeepsRangesToTheMillimetre) {
  shiftmap::Run run = MakeRun(1);
  run.lidar_scans = {{run.odometry[0].stamp, {}, {1.23449f, 1.2345f, 0.0004f, 9999.9996f}}};
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  const auto log = ReadRunLog(path_);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  EXPECT_EQ(log->run.lidar_scans[0].ranges_m, (std::vector{1.234f, 1.235f, 0.0f, 10'000.0f}));
}

TEST_F(RunLogTest, TheSameRunGivesTheSameBytes) {
  const shiftmap::Run run = MakeRun(300);
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  const std::string first = Bytes(path_);
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  EXPECT_EQ(Bytes(path_), first);
}

TEST_F(RunLogTest, KeepsStampsBeforeTheEpochAndNegativeZero) {
  shiftmap::Run run;
  run.odometry.push_back({StampFromNanoseconds(-5), -0.0, 1e-310});
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  const auto log = ReadRunLog(path_);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  EXPECT_EQ(ToNanoseconds(log->run.odometry[0].stamp), -5);
  EXPECT_TRUE(std::signbit(log->run.odometry[0].v_mps));
  EXPECT_EQ(log->run.odometry[0].omega_radps, 1e-310);
}

// A power cut loses less than a second of a log with the default options.
TEST_F(RunLogTest, ACutLosesTheLastSecond) {
  const shiftmap::Run run = MakeRun(3000);  // 30 s.
  ASSERT_TRUE(WriteRunLog(run, path_).ok());
  const std::string bytes = Bytes(path_);
  Put(bytes.substr(0, bytes.size() * 2 / 3));
  const auto log = ReadRunLog(path_);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  ExpectPrefix(log->run, run);
  EXPECT_NE(log->truncation, "");
  // Bytes are alike over time, to a second.
  EXPECT_GT(log->run.odometry.back().stamp, run.odometry.front().stamp + std::chrono::seconds(18));
}

TEST_F(RunLogTest, StreamsInTheOrderOfTime) {
  const shiftmap::Run run = MakeRun(200);
  ASSERT_TRUE(WriteRunLog(run, path_, {true, 2000}).ok());
  auto stream = RunLogStream::Open(path_);
  ASSERT_TRUE(stream.ok());
  const std::vector<RunEvent> expected = MergeEvents(run);
  for (const RunEvent& event : expected) {
    const auto got = stream->Next();
    ASSERT_TRUE(got.ok() && got->has_value());
    EXPECT_EQ((*got)->index(), event.index());
    EXPECT_EQ(StampOf(**got), StampOf(event));
    EXPECT_EQ(stream->info().vehicle, "truck 7");
  }
  const auto end = stream->Next();
  ASSERT_TRUE(end.ok());
  EXPECT_FALSE(end->has_value());
}

TEST_F(RunLogTest, APipeWithANameIsRefusedWithoutWaiting) {
  const std::string pipe = (folder_ / "pipe").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_EQ(RunLogStream::Open(pipe).status().code(), StatusCode::kInvalidArgument);
}

// Every seventh byte; mcap_damage_test.cc tries every one.
TEST_F(RunLogTest, TruncationGivesAPrefix) {
  const shiftmap::Run run = MakeRun(20);
  ASSERT_TRUE(WriteRunLog(run, path_, {true, 300}).ok());
  const std::string bytes = Bytes(path_);
  for (std::size_t length = 0; length < bytes.size(); length += 7) {
    Put(bytes.substr(0, length));
    const auto log = ReadRunLog(path_);
    if (!log.ok()) {  // Nothing of the run is whole.
      EXPECT_EQ(log.status().code(), StatusCode::kInvalidArgument) << length;
      EXPECT_LT(length, bytes.size() / 2);
      continue;
    }
    EXPECT_NE(log->truncation.find("at byte " + std::to_string(length)), std::string::npos);
    ExpectPrefix(log->run, run);
  }
}

TEST_F(RunLogTest, ADamagedChunkIsDataLoss) {
  ASSERT_TRUE(WriteRunLog(MakeRun(100), path_, {false, 1000}).ok());
  std::string bytes = Bytes(path_);
  bytes[bytes.size() / 3] = static_cast<char>(bytes[bytes.size() / 3] ^ 4);
  Put(bytes);
  ExpectError(StatusCode::kDataLoss, "byte ");
}

TEST_F(RunLogTest, NamesWhatIsWrongWithTheFile) {
  ExpectError(StatusCode::kNotFound, "does not exist");
  Put("");
  ExpectError(StatusCode::kInvalidArgument, "not an mcap file");
  Put("a text of some length");
  ExpectError(StatusCode::kInvalidArgument, "not an mcap file");
  path_ = folder_.string();
  ExpectError(StatusCode::kInvalidArgument, "folder");
}

TEST_F(RunLogTest, NamesWhatIsWrongWithAMessage) {
  const std::string nan = EncodeOdometry({StampFromNanoseconds(1), std::nan(""), 0.0});
  PutMessage("/odometry", "shiftmap.proto.Odometry", "protobuf", nan);
  ExpectError(StatusCode::kInvalidArgument, "expected finite numbers");
  PutMessage("/odometry", "shiftmap.proto.Odometry", "protobuf", "\xff\xff\xff");
  ExpectError(StatusCode::kInvalidArgument, "shiftmap.proto.Odometry");
  PutMessage("/odometry", "nav_msgs/Odometry", "ros1", nan);
  ExpectError(StatusCode::kInvalidArgument, "'nav_msgs/Odometry'");
  // A scan with one observation (field 2) that holds nothing.
  PutMessage("/landmarks", "shiftmap.proto.LandmarkScan", "protobuf", std::string("\x12\x00", 2));
  ExpectError(StatusCode::kInvalidArgument, "neither range_bearing nor position_in_vehicle");
}

// As a recorder that is not ours would write it.
TEST_F(RunLogTest, NamesWhatIsWrongWithALidarScan) {
  const auto expect_error = [&](const std::vector<std::int32_t>& steps, const std::string& part) {
    proto::LidarScan message;
    message.set_stamp_ns(1);
    message.set_field_of_view_rad(3.0);
    message.set_max_range_m(80.0);
    message.mutable_range_step_mm()->Add(steps.begin(), steps.end());
    PutMessage("/lidar", "shiftmap.proto.LidarScan", "protobuf", message.SerializeAsString());
    ExpectError(StatusCode::kInvalidArgument, part);
  };
  constexpr std::int32_t kMost = std::numeric_limits<std::int32_t>::max();
  expect_error({}, "0 beams, expected 2 to 10000");
  expect_error({5, -6}, "beam 1: range -0.001 m, expected 0 (no return) to 10000");
  expect_error({0, kMost}, "beam 1: range 2147483");
  // The sum does not come back.
  expect_error(std::vector(100, kMost), "beam 0: range 2147483");
  expect_error(std::vector(1'000'000, 0), "10001 beams, expected 2 to 10000");
  expect_error({1, 1}, "no odometry");
  PutMessage("/lidar", "shiftmap.proto.LandmarkScan", "protobuf", "");
  ExpectError(StatusCode::kInvalidArgument, "expected protobuf message 'shiftmap.proto.LidarScan'");
}

TEST_F(RunLogTest, AMessageBeyondTheSizeOfAnItemIsNone) {
  // An observation of a position (field 3) that is all zeros takes four bytes, and much more here.
  std::string scan;
  while (scan.size() <= kMaxItemBytes) scan.append("\x12\x02\x1a\x00", 4);
  PutMessage("/landmarks", "shiftmap.proto.LandmarkScan", "protobuf", scan);
  ExpectError(StatusCode::kInvalidArgument, "bytes, expected at most 1048576");
  // A field (15) that no reader knows.
  const std::string odometry = "\x7a\xff\xff\xff\x01" + std::string((1 << 22) - 1, 'x');
  PutMessage("/odometry", "shiftmap.proto.Odometry", "protobuf", odometry);
  ExpectError(StatusCode::kInvalidArgument, "bytes, expected at most 1048576");
  PutMessage("/camera", "foxglove.CompressedImage", "protobuf", odometry);
  ExpectError(StatusCode::kInvalidArgument, "no odometry");
}

// Neither many samples, scans nor observations, nor long names.
TEST_F(RunLogTest, ReadsNoFurtherThanItsBoundOnMemory) {
  constexpr std::int64_t kMib = std::int64_t{1} << 20;
  const std::string odometry = EncodeOdometry({StampFromNanoseconds(1), 0.0, 0.0});
  const std::string empty = EncodeScan({StampFromNanoseconds(1), {}});
  Observation seen;
  seen.z = {1.0, 0.0};
  const std::string full = EncodeScan({StampFromNanoseconds(1), std::vector(2000, seen)});
  seen.signature = Signature(std::string(200'000, 'x'));
  const std::string named = EncodeScan({StampFromNanoseconds(1), {seen}});
  const auto expect_bound =
      [&](const char* topic, const char* schema, const std::string& data, int count) {
        PutMessage(topic, schema, "protobuf", data, count);
        const Status status = ReadRunLog(path_, {.max_memory_bytes = 2 * kMib}).status();
        EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
        EXPECT_NE(Message(status).find("takes more than 2 MiB"), std::string::npos)
            << Message(status);
        EXPECT_TRUE(Message(status).starts_with("run log '" + path_ + "': ")) << Message(status);
        EXPECT_EQ(
            Message(ReadRunLog(path_, {.max_memory_bytes = 64 * kMib}).status()).find("takes more"),
            std::string::npos);
      };
  expect_bound("/odometry", "shiftmap.proto.Odometry", odometry, 100'000);
  expect_bound("/landmarks", "shiftmap.proto.LandmarkScan", empty, 100'000);
  expect_bound("/landmarks", "shiftmap.proto.LandmarkScan", full, 20);
  expect_bound("/landmarks", "shiftmap.proto.LandmarkScan", named, 20);
  const std::string lidar =
      EncodeLidarScan({StampFromNanoseconds(1), {}, std::vector(10'000, 1.0f)});
  expect_bound("/lidar", "shiftmap.proto.LidarScan", lidar, 100);
}

TEST_F(RunLogTest, SkipsOtherTopics) {
  PutMessage("/camera", "foxglove.CompressedImage", "protobuf", "whatever");
  ExpectError(StatusCode::kInvalidArgument, "no odometry");
}

TEST_F(RunLogTest, DoesNotWriteWhatItWouldNotRead) {
  shiftmap::Run backwards = MakeRun(5);
  std::swap(backwards.odometry[1], backwards.odometry[2]);
  shiftmap::Run not_utf8 = MakeRun(5);
  not_utf8.scans[1].observations.resize(1);
  not_utf8.scans[1].observations[0].signature = Signature("\xff");
  not_utf8.scans[1].observations[0].z = {1.0, 0.0};
  for (const shiftmap::Run& run : {shiftmap::Run(), backwards, not_utf8}) {
    const Status status = WriteRunLog(run, path_);
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
    EXPECT_TRUE(Message(status).starts_with("run log '" + path_ + "': ")) << Message(status);
  }
  EXPECT_EQ(WriteRunLog(MakeRun(5), path_, {true, 0}).code(), StatusCode::kInvalidArgument);
  shiftmap::Run too_large = MakeRun(5);
  Observation seen;
  seen.z = {1.0, 0.0};
  too_large.scans[0].observations.assign(100'000, seen);
  EXPECT_EQ(WriteRunLog(too_large, path_).code(), StatusCode::kInvalidArgument);
  EXPECT_TRUE(std::filesystem::is_empty(folder_));
  EXPECT_EQ(WriteRunLog(MakeRun(5), (folder_ / "none" / "run.mcap").string()).code(),
            StatusCode::kNotFound);
}

}  // namespace
}  // namespace shiftmap
