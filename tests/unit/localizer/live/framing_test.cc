// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/framing.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "localizer/live/client.h"
#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "localizer/live/journal_file.h"
#include "localizer/live/unix_socket.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap::live {
namespace {

using testing::StatusIs;

TEST(FramingTest, AnySplitGivesTheSameMessages) {
  std::mt19937_64 random(testing::TestSeed(5));
  std::vector<std::string> messages;
  std::string stream;
  for (const std::size_t length : {0u, 1u, 127u, 128u, 16383u, 16384u, 70000u}) {
    messages.emplace_back(length, static_cast<char>('a' + length % 26));
    stream += Framed(messages.back());
  }
  for (int trial = 0; trial < 50; ++trial) {
    FrameReader reader;
    std::vector<std::string> got;
    for (std::size_t at = 0; at < stream.size();) {
      const std::size_t most = trial == 0 ? 1 : 1 + random() % 9000;
      const std::size_t count = std::min(most, stream.size() - at);
      reader.Append(std::string_view(stream).substr(at, count));
      at += count;
      for (;;) {
        const auto message = reader.Next();
        ASSERT_TRUE(message.ok());
        if (!message->has_value()) break;
        got.push_back(**message);
      }
    }
    EXPECT_TRUE(got == messages);
    EXPECT_EQ(reader.pending(), 0u);
  }
}

TEST(FramingTest, HugeLengthIsRefusedBeforeItsBytesAreThere) {
  for (const std::string prefix : {"\xff\xff\xff\xff\x0f", "\xff\xff\x7f", "\x80\x80\x80\x80"}) {
    FrameReader reader;
    reader.Append(prefix);
    EXPECT_THAT(reader.Next(), StatusIs(StatusCode::kInvalidArgument, "longer than"));
  }
  FrameReader longest;
  longest.Append(Framed(std::string(kMaxFrameBytes, 'x')));
  EXPECT_EQ((*longest.Next())->size(), kMaxFrameBytes);
}

// Whatever comes in, requests are refused or taken, and nothing else happens.
TEST(FramingTest, GarbageIsNoRequest) {
  std::mt19937_64 random(testing::TestSeed(6));
  for (int trial = 0; trial < 2000; ++trial) {
    std::string bytes(random() % 64, '\0');
    for (char& byte : bytes) byte = static_cast<char>(random());
    std::uint64_t id = 0;
    (void)DecodeRequest(bytes, &id);
  }
  std::uint64_t id = 0;
  EXPECT_THAT(DecodeRequest("", &id), StatusIs(StatusCode::kInvalidArgument, "without a command"));
}

TEST(FramingTest, BadValuesAreRefusedWithTheirId) {
  const double nan = std::nan("");
  std::uint64_t id = 0;
  OdometrySample sample{.stamp = StampFromSeconds(5.0), .v_mps = nan, .omega_radps = 0.0};
  EXPECT_THAT(DecodeRequest(EncodeRequest({7, sample}), &id),
              StatusIs(StatusCode::kInvalidArgument, "finite"));
  EXPECT_EQ(id, 7u);
  sample = {.stamp = Stamp::min(), .v_mps = 0.0, .omega_radps = 0.0};
  EXPECT_THAT(DecodeRequest(EncodeRequest({8, sample}), &id),
              StatusIs(StatusCode::kInvalidArgument, "stamp_ns"));
  Scan scan;
  scan.stamp = StampFromSeconds(5.0);
  scan.observations.emplace_back().signature = Signature(std::string(2000, 's'));
  scan.observations.back().z = {1.0, 0.0};
  EXPECT_THAT(DecodeRequest(EncodeRequest({9, scan}), &id),
              StatusIs(StatusCode::kInvalidArgument, "signature"));
  InitializePose flat;  // Its covariance is zero.
  EXPECT_THAT(DecodeRequest(EncodeRequest({10, flat}), &id),
              StatusIs(StatusCode::kInvalidArgument, "positive definite"));
  InitializePose far;
  far.pose = {Se2(1e300, 0.0, 0.0), Eigen::Matrix3d::Identity()};
  EXPECT_THAT(DecodeRequest(EncodeRequest({11, far}), &id),
              StatusIs(StatusCode::kInvalidArgument, "1e+300"));
  // What is no UTF-8 is no message; who asked waits for an answer.
  id = 0;
  EXPECT_THAT(DecodeRequest(EncodeRequest({12, Start{"\xff", std::nullopt}}), &id),
              StatusIs(StatusCode::kInvalidArgument, "not a shiftmap.proto.Request message"));
  EXPECT_EQ(id, 12u);
}

TEST(FramingTest, LidarScansSurviveTheWireAndTheJournal) {
  LidarScan scan{StampFromSeconds(5.0), {}, {1.25f, 0.0f, 80.0f}};
  scan.sensor.T_vehicle_lidar = Se2(1.0, -0.5, 0.3);
  std::uint64_t id = 0;
  const auto request = DecodeRequest(EncodeRequest({7, scan}), &id);
  ASSERT_THAT(request, testing::IsOk());
  EXPECT_EQ(std::get<LidarScan>(request->command).ranges_m, scan.ranges_m);
  const auto record = DecodeJournalRecord(EncodeJournalRecord(scan));
  ASSERT_THAT(record, testing::IsOk());
  EXPECT_EQ(std::get<LidarScan>(*record).ranges_m, scan.ranges_m);
  EXPECT_EQ(std::get<LidarScan>(*record).sensor.T_vehicle_lidar.yaw(), 0.3);
  scan.ranges_m[1] = -1.0f;
  EXPECT_THAT(DecodeRequest(EncodeRequest({8, scan}), &id),
              StatusIs(StatusCode::kInvalidArgument, "beam 1: range -1 m"));
  EXPECT_EQ(id, 8u);
  scan = {StampFromSeconds(-5.0), {}, {1.0f, 1.0f}};
  EXPECT_THAT(DecodeRequest(EncodeRequest({9, scan}), &id),
              StatusIs(StatusCode::kInvalidArgument, "stamp_ns"));
}

TEST(FramingTest, TheJournalKeepsTheFieldOfView) {
  ShiftHeader header;
  for (const FieldOfViewModel model : {FieldOfViewModel::kSector, FieldOfViewModel::kScanPolygon}) {
    header.field_of_view = model;
    const auto record = DecodeJournalRecord(EncodeJournalRecord(header));
    ASSERT_THAT(record, testing::IsOk());
    EXPECT_EQ(std::get<ShiftHeader>(*record).field_of_view, model);
  }
  header.field_of_view = static_cast<FieldOfViewModel>(2);
  EXPECT_THAT(DecodeJournalRecord(EncodeJournalRecord(header)),
              StatusIs(StatusCode::kInvalidArgument, "field_of_view: 2"));
}

TEST(FramingTest, RepliesSurviveTheWire) {
  Reply reply;
  reply.id = 3;
  reply.status = NotFound("area 'cellar'");
  reply.state.emplace();
  reply.state->running = true;
  reply.state->localizer_state = LocalizerState::kLost;
  reply.state->pose = PoseWithCovariance{Se2(1.0, 2.0, 0.5), Eigen::Matrix3d::Identity()};
  reply.state->dropped = {{"future", 4}};
  reply.state->time_line = TimeLine::kFuture;
  reply.state->clock_jumps = 2;
  const auto event = DecodeEvent(EncodeEvent(reply));
  ASSERT_TRUE(event.ok());
  const Reply& got = std::get<Reply>(*event);
  EXPECT_EQ(got.id, 3u);
  EXPECT_EQ(got.status, reply.status);
  EXPECT_EQ(got.state->localizer_state, LocalizerState::kLost);
  EXPECT_EQ(got.state->pose->T_map_vehicle.yaw(), 0.5);
  EXPECT_EQ(got.state->dropped.at(0).count, 4);
  EXPECT_EQ(got.state->time_line, TimeLine::kFuture);
  EXPECT_EQ(got.state->clock_jumps, 2);
}

// Observations at the origin, which take the fewest bytes on the wire.
Scan ScanOf(std::size_t observations) {
  Scan scan;
  scan.stamp = StampFromSeconds(5.0);
  scan.observations.resize(observations);
  for (Observation& seen : scan.observations) seen.kind = Observation::Kind::kCartesian;
  return scan;
}

TEST(FramingTest, WhatFitsAFrameFitsAJournalRecord) {
  const std::string frame = EncodeRequest({0, ScanOf(kMaxFrameBytes / 4 - 10)});
  ASSERT_LE(frame.size(), kMaxFrameBytes);
  EXPECT_GT(frame.size(), kMaxFrameBytes / 10 * 9);
  std::uint64_t id = 0;
  const auto request = DecodeRequest(frame, &id);
  ASSERT_TRUE(request.ok());
  EXPECT_LE(EncodeJournalRecord(std::get<Scan>(request->command)).size(),
            JournalFile::kMaxRecordBytes);
}

TEST(FramingTest, WhatFitsNoFrameIsRefusedByItsSender) {
  const testing::TempDir folder;
  const auto listener = ListenAt(folder.File("s"));
  ASSERT_TRUE(listener.ok());
  auto client = Client::Connect(folder.File("s"));
  ASSERT_TRUE(client.ok());
  EXPECT_THAT(client->Send({0, ScanOf(kMaxFrameBytes)}),
              StatusIs(StatusCode::kInvalidArgument, "request of"));
}

}  // namespace
}  // namespace shiftmap::live
