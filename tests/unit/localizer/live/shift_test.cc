// SPDX-License-Identifier: Apache-2.0
#include "localizer/live/shift.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <variant>
#include <vector>

#include "localizer/initialization/start_pose.h"
#include "localizer/live/codec/journal_codec.h"
#include "localizer/live/codec/live_codec.h"
#include "mapstore/map/shift_report_check.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap::live {
namespace {

using ::shiftmap::testing::IsOk;
using ::shiftmap::testing::StatusIs;

constexpr double kFar = 1e9;

ShiftHeader Header() {
  ShiftHeader header;
  header.uuid = "0f8fad5b-d9cb-469f-a165-70867728950e";
  header.vehicle = "truck";
  header.alpha = 1e-4;
  header.max_leaves = 8;
  header.limits.max_range_m = kFar;
  return header;
}

std::int64_t CountOf(const std::string& reason, const ShiftReport& report) {
  for (const DroppedCount& dropped : report.dropped) {
    if (dropped.reason == reason) return dropped.count;
  }
  return 0;
}

class ShiftTest : public ::testing::Test {
 protected:
  ShiftTest() : content_(MakeTwoModeMap(12, 12.0, 2)) {
    const std::vector<int> states(content_.groups.size(), 1);
    items_ = MergeEvents(Simulate(content_, PositionsOf(content_, states), {}).run);
  }

  Shift MakeShift(const ShiftHeader& header) const { return Shift(Snapshot(content_), header); }

  void Feed(std::size_t begin, std::size_t end, Shift* shift) const {
    std::vector<Event> events;
    for (std::size_t i = begin; i < end; ++i) {
      ASSERT_THAT(shift->Process(items_[i], &events), IsOk());
    }
  }

  // A scan of 20 landmarks that the map does not know, all around at a range.
  Scan UnknownAt(double range_m, Stamp stamp) const {
    Scan scan{stamp, {}};
    for (int i = 0; i < 20; ++i) {
      Observation& observation = scan.observations.emplace_back();
      observation.signature = Signature("unknown " + std::to_string(i));
      observation.z = {range_m, 0.3 * i - 3.0};
    }
    return scan;
  }

  // A report whose head is complete, as a service makes it.
  static ShiftReport ReportOf(const Shift& shift) {
    ShiftReport report = shift.Report({});
    report.software = "test";
    report.area = "hall";
    report.version = VersionNumber(1);
    report.content_hash = std::string(64, 'a');
    return report;
  }

  MapContent content_;
  std::vector<RunEvent> items_;
};

TEST_F(ShiftTest, EndsWhateverWasSighted) {
  Shift shift = MakeShift(Header());
  Feed(0, items_.size() / 2, &shift);
  std::vector<Event> events;
  ASSERT_THAT(shift.Process(UnknownAt(kFar, shift.now()), &events), IsOk());
  Feed(items_.size() / 2, items_.size(), &shift);
  const ShiftReport report = ReportOf(shift);
  EXPECT_THAT(ValidateShiftReport(report), IsOk());
  EXPECT_FALSE(report.evidence.empty());
  EXPECT_EQ(
      CountOf("invalid_sighting", report) + static_cast<std::int64_t>(report.sightings.size()), 20);
}

TEST_F(ShiftTest, CountsWhatNoSensorSees) {
  ShiftHeader header = Header();
  header.limits = {};
  Shift shift = MakeShift(header);
  Feed(0, items_.size() / 2, &shift);
  EXPECT_EQ(shift.localizer().first_implausible(), "");
  std::vector<Event> events;
  ASSERT_THAT(shift.Process(UnknownAt(kFar, shift.now()), &events), IsOk());
  OdometrySample fast{shift.now(), kFar, 0.0};
  ASSERT_THAT(shift.Process(fast, &events), IsOk());
  EXPECT_NE(shift.localizer().first_implausible().find("unknown 0"), std::string::npos);
  Feed(items_.size() / 2, items_.size(), &shift);
  const ShiftReport report = ReportOf(shift);
  EXPECT_EQ(CountOf("implausible_observation", report), 20);
  EXPECT_EQ(CountOf("implausible_odometry", report), 1);
  EXPECT_TRUE(report.sightings.empty());
  EXPECT_EQ(shift.localizer().state(), LocalizerState::kTracking);
}

TEST_F(ShiftTest, JournalKeepsTheLimits) {
  const auto record = DecodeJournalRecord(EncodeJournalRecord(Header()));
  ASSERT_THAT(record, IsOk());
  const LocalizerOptions options = Shift::OptionsOf(std::get<ShiftHeader>(*record));
  EXPECT_EQ(options.limits.max_range_m, kFar);
  EXPECT_FALSE(options.limits.max_speed_mps);
  EXPECT_FALSE(options.limits.max_yaw_rate_radps);
}

// Builds before there were bounds on a start wrote such records.
TEST_F(ShiftTest, JournalMayHoldAStartThatIsRefusedNow) {
  InitializePose start;
  start.pose.cov_T_map_vehicle = Eigen::Matrix3d::Identity() * 1e18;
  EXPECT_THAT(ValidateStart(start.pose), StatusIs(StatusCode::kInvalidArgument, "1000"));
  std::uint64_t id = 0;
  EXPECT_THAT(DecodeRequest(EncodeRequest({1, start}), &id),
              StatusIs(StatusCode::kInvalidArgument, "standard deviations"));
  const auto record = DecodeJournalRecord(EncodeJournalRecord(start));
  ASSERT_THAT(record, IsOk());
  Shift shift = MakeShift(Header());
  shift.Initialize(std::get<InitializePose>(*record).pose);
  Feed(0, items_.size(), &shift);
  EXPECT_EQ(shift.localizer().state(), LocalizerState::kTracking);
  EXPECT_THAT(ValidateShiftReport(ReportOf(shift)), IsOk());
}

}  // namespace
}  // namespace shiftmap::live
