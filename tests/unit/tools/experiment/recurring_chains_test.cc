// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/recurring_chains.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <string>

#include "tests/support/temp_dir.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

std::string WriteText(const std::string& path, const std::string& text) {
  std::ofstream(path) << text;
  return path;
}

// Three states that differ, minute by minute for some days.
RecurringRecord Simulated(const ModeChain& chain, int minutes) {
  RecurringRecord like{"thing", 3, {}, {0}};
  for (int i = 0; i < minutes; ++i) like.stamps.push_back(StampFromSeconds(60.0 * i));
  return SimulateRecord(like, chain, 5);
}

ModeChain Truth() {
  Eigen::MatrixXd rates(3, 3);
  rates << -3e-4, 2e-4, 1e-4, 5e-4, -1e-3, 5e-4, 1e-4, 1e-5, -1.1e-4;
  return *ModeChain::FromRates(rates);
}

TEST(RecurringChainsTest, LearnedRatesComeNearTheTruthAndBeatTheRest) {
  const ModeChain truth = Truth();
  const RecurringRecord record = Simulated(truth, 40'000);
  RecurringChainsOptions options;
  options.train = {{"10 min", 600.0}};
  options.test = {{"10 min", 600.0}};
  const auto rows = CompareChains(record, &truth, options, [](double) {});
  ASSERT_TRUE(rows.ok());
  const auto nats = [&](const std::string& method) {
    const auto row = std::find_if(
        rows->begin(), rows->end(), [&](const auto& other) { return other.method == method; });
    return row == rows->end() ? 0.0 : row->nats_per_hour;
  };
  ASSERT_EQ(rows->size(), 7u);
  for (const char* method : {"hand-set", "frequency", "uniform"}) {
    EXPECT_GT(nats("general"), nats(method) + 0.02) << method;
  }
  EXPECT_NEAR(nats("general"), nats("truth"), 0.02);
  EXPECT_EQ((*rows)[5].rhythm_hours, 0.0);
}

TEST(RecurringDataTest, SpacedVisitsKeepTheirDistance) {
  const RecurringRecord record = Simulated(Truth(), 5'000);
  const std::vector<std::size_t> hourly = SpacedVisits(record, 100, 4'000, {"1 h", 3600.0}, 1);
  EXPECT_EQ(hourly.size(), 65u);
  EXPECT_EQ(hourly.front(), 100u);
  EXPECT_EQ(hourly[1], 160u);
  const std::vector<std::size_t> random = SpacedVisits(record, 0, 5'000, {"random", 0.0}, 1);
  EXPECT_GT(random.size(), 10u);
  EXPECT_TRUE(CheckHistory(VisitRecord(record, random)).ok());
}

TEST(RecurringDataTest, ReadsRecords) {
  const TempDir dir;
  const auto door = ReadDoorRecord(WriteText(dir.File("door"), "1000 0\n1060 1\n1180 1\n"));
  ASSERT_TRUE(door.ok());
  EXPECT_EQ(door->values, (std::vector<int>{0, 1, 1}));
  EXPECT_EQ(door->stamps.back(), StampFromSeconds(1180.0));
  const auto rooms = ReadRoomRecord(WriteText(dir.File("rooms"), "3\n0\n1\n"));
  ASSERT_TRUE(rooms.ok());
  EXPECT_EQ(rooms->states, 3);
  EXPECT_EQ(rooms->values, (std::vector<int>{2, 0}));
  EXPECT_EQ(rooms->stamps.back(), StampFromSeconds(120.0));
}

TEST(RecurringDataTest, NamesTheBadLine) {
  const TempDir dir;
  const auto message = [&](const std::string& text) {
    return Message(ReadDoorRecord(WriteText(dir.File("door"), text)).status());
  };
  EXPECT_THAT(message("1000 0\n1060 2\n"), HasSubstr("line 2: '1060 2', expected 'unix_time 0|1'"));
  EXPECT_THAT(message("1000 0\n1000 1\n"), HasSubstr("line 2: time 1000 does not ascend"));
  EXPECT_THAT(Message(ReadRoomRecord(WriteText(dir.File("rooms"), "1\nx\n")).status()),
              HasSubstr("line 2: 'x', expected a room's number"));
  EXPECT_EQ(ReadDoorRecord(dir.File("none")).status().code(), StatusCode::kNotFound);
}

}  // namespace
}  // namespace shiftmap::testing
