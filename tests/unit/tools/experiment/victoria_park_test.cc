// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/victoria_park.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>

namespace shiftmap {
namespace {

TEST(ScoreAgainstGps, FindsTheAlignmentDespiteJumps) {
  const Se2 T_gps_start(40.0, -30.0, 2.0);
  const Eigen::Vector2d antenna(3.0, 0.5);
  std::vector<StampedPose> trajectory;
  std::vector<GpsFix> fixes;
  for (int i = 0; i < 200; ++i) {
    const Stamp stamp = StampFromSeconds(10.0 + 0.2 * i);
    const Se2 pose(0.4 * i, 5.0 * std::sin(0.05 * i), 0.25 * std::cos(0.05 * i));
    trajectory.push_back({stamp, pose});
    Eigen::Vector2d p = T_gps_start * (pose * antenna);
    p.x() += i % 2 == 0 ? 0.3 : -0.3;
    if (i % 20 == 0) p += Eigen::Vector2d(30.0, 15.0);
    fixes.push_back({stamp, p});
  }
  fixes.push_back({StampFromSeconds(1000.0), Eigen::Vector2d(1e4, 0.0)});  // After the run.
  const auto score = ScoreAgainstGps(trajectory, fixes, antenna);
  ASSERT_TRUE(score.ok());
  EXPECT_NEAR(score->rmse_m, 0.3, 0.01);
  EXPECT_NEAR(score->used_share, 0.95, 1e-9);
  EXPECT_LT((score->T_gps_start.Inverse() * T_gps_start).Log().norm(), 0.1);
  EXPECT_FALSE(ScoreAgainstGps(trajectory, {}, antenna).ok());
}

TEST(VictoriaPark, EveryNthScan) {
  shiftmap::Run run;
  run.scans.resize(10);
  EXPECT_EQ(WithEveryScan(4, run).scans.size(), 3U);
}

// A fifth of the scans, to be quick.
TEST(VictoriaPark, MapsTheParkWithoutIdentities) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const auto root = std::filesystem::path(data != nullptr ? data : "../shared/data");
  VictoriaParkOptions options;
  options.dataset_dir = (root / "victoria_park").string();
  if (!std::filesystem::exists(options.dataset_dir)) {
    GTEST_SKIP() << "no Victoria Park data: set SHIFTMAP_DATA to the folder that holds it";
  }
  const auto park = ReadVictoriaPark(options);
  const auto fixes = ReadVictoriaParkGps(options.dataset_dir);
  ASSERT_TRUE(park.ok() && fixes.ok());
  const shiftmap::Run run = WithEveryScan(5, park->run);
  const auto score = [&](const ParkResult& result) {
    return ScoreAgainstGps(result.trajectory, *fixes, kVictoriaParkLaser)->rmse_m;
  };
  const double reckoned = score(RunDeadReckoning(run, {}));
  MapperOptions mapper_options;
  mapper_options.association.min_sightings = 4;
  const auto mapped = RunMapper(run, mapper_options);
  ASSERT_TRUE(mapped.ok()) << Message(mapped.status());
  RecordProperty("rmse_m", std::to_string(score(*mapped)));
  EXPECT_GT(reckoned, 50.0);
  EXPECT_LT(score(*mapped), 2.0);
  EXPECT_GT(mapped->associated, mapped->observations * 8 / 10);
  EXPECT_GT(mapped->landmarks.size(), 150U);
  EXPECT_LT(mapped->landmarks.size(), 400U);
}

}  // namespace
}  // namespace shiftmap
