// SPDX-License-Identifier: Apache-2.0
#include "mapper/memory_estimate.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <set>
#include <string>
#include <vector>

#include "mapper/graph/graph_segments.h"
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
  constexpr std::int64_t kFrames = kSegmentPoses + 1;
  EXPECT_GT(size.segment_boundary * kFrames, 14 * size.key_frames);
  EXPECT_LE(size.segment_boundary * kFrames,
            (12 + 2 * size.landmarks) * (size.key_frames + kFrames));
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

// A run of so many landmarks, seen from as many places.
BuildSize SizeOfRun(std::int64_t landmarks) {
  BuildSize size;
  size.runs = 1;
  size.scans = size.key_frames = landmarks;
  size.observations = 4 * landmarks;
  size.landmarks = size.all_landmarks = landmarks;
  size.landmark_pairs = landmarks * landmarks;
  return size;
}

// The smallest that fit, in any order: all orders against a search over the sorted runs.
TEST(RunChoice, LeavesOutTheLargestInAnyOrder) {
  const std::map<std::string, std::int64_t> landmarks = {
      {"a", 300}, {"b", 20}, {"c", 900}, {"d", 300}, {"e", 500}};
  const std::vector<std::string> by_size = {"b", "a", "d", "e", "c"};
  for (const std::int64_t max_mib : {1, 25, 40, 70, 150, 300, 5000}) {
    BuildSize total;
    std::set<std::string> expected;
    for (const std::string& id : by_size) {
      AddSize(SizeOfRun(landmarks.at(id)), &total);
      total.runs_at_once = std::min<std::int64_t>(2, total.runs);
      if (!CheckBuildMemory(total, max_mib * kMib).ok()) break;
      expected.insert(id);
    }
    std::vector<std::string> order = {"a", "b", "c", "d", "e"};
    do {
      RunChoice choice(max_mib * kMib, 0, 2);
      std::set<std::string> kept;
      for (const std::string& id : order) {
        kept.insert(id);
        for (const RunChoice::LeftOut& out : choice.Add(id, SizeOfRun(landmarks.at(id)))) {
          EXPECT_EQ(kept.erase(out.id), 1u);
          EXPECT_NE(out.reason.find(fmt::format("allowed are {} ", max_mib)), std::string::npos);
        }
      }
      ASSERT_EQ(kept, expected) << max_mib << " MiB";
    } while (std::next_permutation(order.begin(), order.end()));
  }
}

TEST(RunChoice, CountsThePriorMap) {
  RunChoice alone(40 * kMib, 0, 1);
  EXPECT_TRUE(alone.Add("a", SizeOfRun(20)).empty());
  RunChoice of_large_map(40 * kMib, 2000, 1);
  EXPECT_EQ(of_large_map.Add("a", SizeOfRun(20)).size(), 1u);
}

}  // namespace
}  // namespace shiftmap
