// SPDX-License-Identifier: Apache-2.0
#include "mapper/memory_estimate.h"

#include <gtest/gtest.h>

#include <vector>

#include "tests/support/status_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using testing::StatusIs;

constexpr std::int64_t kMib = std::int64_t{1024} * 1024;

// Runs of different lengths.
std::vector<Run> RunsOf(std::initializer_list<double> durations_s) {
  std::vector<Run> runs;
  for (const double duration_s : durations_s) {
    OpenWorldOptions options = testing::SmallWorld(3);
    options.runs = 1;
    options.duration_s = duration_s;
    runs.push_back(testing::Simulate(options).runs.front().run);
  }
  return runs;
}

BuildSize SizeOf(const std::vector<Run>& runs, const std::vector<std::size_t>& order) {
  BuildSize size;
  for (const std::size_t i : order) AddRun(runs[i], &size);
  return size;
}

TEST(BuildMemory, TheOrderOfLogsDoesNotMatter) {
  const auto runs = RunsOf({20.0, 90.0, 50.0});
  for (const std::int64_t prior_modes : {0, 40}) {
    const auto estimate = [&](const std::vector<std::size_t>& order) {
      BuildSize size = SizeOf(runs, order);
      size.prior_modes = prior_modes;
      return EstimateBuildMemory(size);
    };
    EXPECT_EQ(estimate({0, 1, 2}), estimate({1, 2, 0}));
    EXPECT_EQ(estimate({0, 1, 2}), estimate({2, 1, 0}));
  }
}

TEST(BuildMemory, ModesAreThoseOfTheLargestRunUntilTheyAreKnown) {
  const auto runs = RunsOf({90.0, 90.0});
  const BuildSize one = SizeOf(runs, {0});
  BuildSize both = SizeOf(runs, {0, 1});
  EXPECT_EQ(one.landmarks, one.all_landmarks);
  EXPECT_EQ(both.all_landmarks, 2 * one.landmarks);
  EXPECT_EQ(ExpectedModes(both), one.landmarks + one.landmarks / 4 + 2);
  const std::int64_t expected = EstimateBuildMemory(both);
  both.modes = ExpectedModes(both);
  EXPECT_EQ(EstimateBuildMemory(both), expected);
  both.modes = 250;
  EXPECT_GT(EstimateBuildMemory(both), expected);
}

// Every scan is part of one segment, and sees no less than one landmark.
TEST(BuildMemory, GrowsWithWhatSegmentsSee) {
  const BuildSize size = SizeOf(RunsOf({90.0}), {0});
  EXPECT_GT(size.segment_boundary * 32, 14 * size.key_frames);
  EXPECT_LE(size.segment_boundary * 32, (12 + 2 * size.landmarks) * (size.key_frames + 32));
  BuildSize denser = size;
  denser.segment_pairs *= 100;
  EXPECT_GT(EstimateBuildMemory(denser), EstimateBuildMemory(size));
}

TEST(BuildMemory, TooMuchIsRefusedWithBothFigures) {
  const BuildSize size = SizeOf(RunsOf({20.0}), {0});
  const std::int64_t needed = EstimateBuildMemory(size);
  EXPECT_THAT(CheckBuildMemory(size, 0), testing::IsOk());
  EXPECT_THAT(CheckBuildMemory(size, needed), testing::IsOk());
  EXPECT_THAT(CheckBuildMemory(size, 2 * kMib),
              StatusIs(StatusCode::kInvalidArgument, "MiB, allowed are 2;"));
}

}  // namespace
}  // namespace shiftmap
