// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/nights.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;

TEST(NightsWorldTest, WhatIsRemovedStaysAway) {
  NightsOptions options;
  options.nights = 9;
  options.groups = 40;
  options.duration_s = 1.0;
  const StatusOr<NightsWorld> nights = DrawNights(options);
  ASSERT_THAT(nights, IsOk());
  ASSERT_EQ(nights->world.runs.size(), 45u);
  EXPECT_EQ(nights->world.runs[6].run.info.vehicle, "vehicle-2");
  int removed = 0;
  for (std::size_t g = 0; g < nights->removed.size(); ++g) {
    if (!nights->removed[g]) continue;
    ++removed;
    for (int run = *nights->removed[g]; run < 45; ++run) {
      EXPECT_EQ(nights->world.runs[static_cast<std::size_t>(run)].active_mode[g], kAbsent);
    }
  }
  EXPECT_GT(removed, 0);
}

// The share that moves between two days is near that of a new layout, and far from it else.
TEST(NightsWorldTest, LayoutsChangeAtOnce) {
  NightsOptions options;
  options.nights = 4;
  options.groups = 200;
  options.size_m = 100.0;
  options.duration_s = 1.0;
  options.layout_days = 2;
  const StatusOr<NightsWorld> nights = DrawNights(options);
  ASSERT_THAT(nights, IsOk());
  const auto moved = [&](std::size_t run) {
    const std::vector<ModeNumber>& before = nights->world.runs[run - 1].active_mode;
    const std::vector<ModeNumber>& after = nights->world.runs[run].active_mode;
    int count = 0;
    for (std::size_t g = 0; g < after.size(); ++g) count += before[g] != after[g];
    return count;
  };
  for (std::size_t run = 1; run < 20; ++run) {
    if (run == 12) {
      EXPECT_NEAR(moved(run), 0.6 * 0.75 * 200, 30);
    } else {
      EXPECT_LT(moved(run), 30) << run;
    }
  }
}

// A crowded site whose whole layout changes every other day, through the commands of a site.
NightsOptions RestlessSite(std::uint64_t seed, int nights) {
  NightsOptions options;
  options.seed = seed;
  options.nights = nights;
  options.groups = 10;
  options.size_m = 12.0;
  options.duration_s = 60.0;
  options.layout_days = 2;
  options.layout_share = 0.9;
  return options;
}

TEST(NightsTest, NothingIsDecidedWronglyOnARestlessSite) {
  const NightsOptions options = RestlessSite(2, 12);
  const testing::TempDir folder;
  int called = 0;
  const StatusOr<NightsResult> result = DriveNights(
      options, folder.File("site"), {"--threads", "1"}, [&](const NightResult&) { ++called; });
  ASSERT_THAT(result, IsOk());
  ASSERT_EQ(result->nights.size(), 12u);
  EXPECT_EQ(called, 12);
  NightResult sum;
  for (const NightResult& night : result->nights) {
    EXPECT_EQ(night.wrong_starts, 0) << night.night;
    EXPECT_EQ(night.wrong_decisions, 0) << night.night;
    EXPECT_EQ(night.wrong_modes, 0) << night.night;
    EXPECT_LT(night.map_rmse_m, 0.05) << night.night;
    sum.shifts += night.shifts;
    sum.localized += night.localized;
    sum.decisions += night.decisions;
    sum.states += night.states;
    sum.p_true_sum += night.p_true_sum;
  }
  EXPECT_EQ(sum.shifts, 55);
  EXPECT_GT(sum.localized, 50);
  EXPECT_GT(sum.decisions, 1000);
  EXPECT_GT(sum.p_true_sum / sum.states, 0.6);
}

// All but two landmarks of the second layout stand elsewhere than in the first, and these two each
// at two places in both. No run of it has both places of both; together the runs do.
TEST(NightsTest, RunsOfANewLayoutAreMappedOnceTheyDecideTogether) {
  const testing::TempDir folder;
  const StatusOr<NightsResult> result = DriveNights(
      RestlessSite(8, 15), folder.File("site"), {"--threads", "1"}, [](const NightResult&) {});
  ASSERT_THAT(result, IsOk());
  for (const NightResult& night : result->nights) {
    EXPECT_EQ(night.wrong_modes, 0) << night.night;
    EXPECT_LT(night.map_rmse_m, 0.05) << night.night;
  }
  EXPECT_EQ(result->nights[3].unmapped, 8);
  EXPECT_EQ(result->nights[3].waiting, 8);
  EXPECT_LT(result->nights[4].unmapped, 5);  // None but runs of the third layout.
  EXPECT_GT(result->nights[4].modes, result->nights[3].modes + 8);
}

// One of four vehicles, for five days.
NightsResult DriveWithFault(VehicleFault fault) {
  NightsOptions options;
  options.seed = 4;
  options.nights = 9;
  options.vehicles = 4;
  options.groups = 12;
  options.size_m = 15.0;
  options.duration_s = 60.0;
  options.return_at_once = true;
  options.fault = fault;
  options.fault_night = 5;
  options.fault_nights = 5;
  const testing::TempDir folder;
  return DriveNights(options, folder.File("site"), {"--threads", "1"}, [](const NightResult&) {})
      .value();
}

// The oracle: the same days without the fault. After one honest visit the likeliest state is right
// as often, after two it is as sure.
TEST(NightsTest, AVehicleThatReportsFalselyIsNotBelieved) {
  const auto sums = [](const NightsResult& result) {
    std::pair<RecoveryCount, RecoveryCount> sum;
    for (const NightResult& night : result.nights) {
      EXPECT_EQ(night.wrong_decisions, 0) << night.night;
      EXPECT_EQ(night.wrong_modes, 0) << night.night;
      sum.first.states += night.after_one.states;
      sum.first.wrong_likeliest += night.after_one.wrong_likeliest;
      sum.second.states += night.after_two.states;
      sum.second.doubtful += night.after_two.doubtful;
    }
    return sum;
  };
  const auto expected = sums(DriveWithFault(VehicleFault::kNone));
  EXPECT_GT(expected.first.states, 100);
  EXPECT_GT(expected.second.states, 200);
  for (const VehicleFault fault : {VehicleFault::kFalseReports, VehicleFault::kFlood}) {
    const auto with_fault = sums(DriveWithFault(fault));
    EXPECT_GT(with_fault.first.states, 100);
    EXPECT_LE(with_fault.first.wrong_likeliest, expected.first.wrong_likeliest + 1);
    EXPECT_LE(with_fault.second.doubtful, expected.second.doubtful + 2);
  }
}

TEST(NightsTest, AFolderThatIsThereIsLeftAlone) {
  const testing::TempDir folder;
  const StatusOr<NightsResult> result =
      DriveNights({}, folder.path(), {}, [](const NightResult&) {});
  EXPECT_EQ(result.status().code(), StatusCode::kFailedPrecondition);
}

}  // namespace
}  // namespace shiftmap
