// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/lidar_repeatability.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <numbers>

#include "tools/convert/lidar_json.h"

namespace shiftmap {
namespace {

// A scan of 181 beams in a corner at (3, 3) of walls along x = 3 and y = 3.
RangeScan CornerScan(const Se2& pose, double stamp_s) {
  RangeScan scan{StampFromSeconds(stamp_s), {}};
  for (int beam = 0; beam < 181; ++beam) {
    const double yaw = pose.yaw() + (beam - 90) * std::numbers::pi / 180.0;
    double range = 81.0;
    if (std::cos(yaw) > 1e-9) range = std::min(range, (3.0 - pose.x()) / std::cos(yaw));
    if (std::sin(yaw) > 1e-9) range = std::min(range, (3.0 - pose.y()) / std::sin(yaw));
    scan.ranges_m.push_back(range);
  }
  return scan;
}

LidarLog CornerLog() {
  LidarLog log;
  for (const Se2& pose : {Se2(0.0, 0.0, 0.8), Se2(0.2, 0.1, 0.6), Se2(0.8, 0.2, 0.9)}) {
    const double stamp_s = static_cast<double>(log.scans.size());
    log.poses.push_back({StampFromSeconds(stamp_s), pose});
    log.scans.push_back(CornerScan(pose, stamp_s));
  }
  return log;
}

TEST(Repeatability, FindsAnOnlyCornerFromEverywhere) {
  const auto results = MeasureRepeatability(CornerLog(), {});
  ASSERT_TRUE(results.ok()) << Message(results.status());
  ASSERT_EQ(results->size(), 12U);
  std::int64_t pairs = 0;
  for (const Repeatability& result : *results) {
    if (result.points != "flirt") continue;
    pairs += result.pairs;
    EXPECT_EQ(result.in_view, result.pairs);
    EXPECT_EQ(result.found, result.pairs);
    if (result.pairs > 0) {
      EXPECT_LT(result.RmsDistance(), 0.1);
    }
  }
  EXPECT_EQ(pairs, 6);
  EXPECT_EQ(results->front().pairs, 2);  // The first two are 0.22 m apart.
}

// By wrong poses nothing is where it was.
TEST(Repeatability, GoesByThePoses) {
  LidarLog log = CornerLog();
  for (std::size_t i = 0; i < log.poses.size(); ++i) {
    log.poses[i].T_map_vehicle = Se2(0.3 * static_cast<double>(i), 0.0, 0.8);
  }
  const auto results = MeasureRepeatability(log, {});
  ASSERT_TRUE(results.ok());
  for (const Repeatability& result : *results) {
    if (result.points == "flirt") {
      EXPECT_EQ(result.found, 0);
    }
  }
}

TEST(Repeatability, NeedsAPosePerScan) {
  LidarLog log = CornerLog();
  log.poses.pop_back();
  EXPECT_EQ(MeasureRepeatability(log, {}).status().code(), StatusCode::kInvalidArgument);
}

TEST(RepeatabilityData, InterestPointsAreFoundMoreOftenThanOthers) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const auto root = std::filesystem::path(data != nullptr ? data : "../shared/data") / "lidar";
  if (!std::filesystem::exists(root)) {
    GTEST_SKIP() << "no lidar data: set SHIFTMAP_DATA to the folder that holds it";
  }
  const auto log = ReadLidarJson((root / "intel_corrected_log.json").string());
  ASSERT_TRUE(log.ok()) << Message(log.status());
  const auto results = MeasureRepeatability(*log, {});
  ASSERT_TRUE(results.ok());
  for (std::size_t bin = 0; bin < 4; ++bin) {
    EXPECT_GT((*results)[bin].Share(), (*results)[bin + 4].Share() + 0.08) << bin;
    EXPECT_GT((*results)[bin].Share(), 2.0 * (*results)[bin + 8].Share()) << bin;
  }
  EXPECT_GT(results->front().Share(), 0.75);
}

}  // namespace
}  // namespace shiftmap
