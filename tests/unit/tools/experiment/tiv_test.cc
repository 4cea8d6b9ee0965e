// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tools/experiment/static_slam.h"
#include "tools/experiment/tiv_mine.h"
#include "tools/experiment/tiv_picture.h"
#include "tools/experiment/tiv_removal.h"

namespace shiftmap {
namespace {

using testing::IsOk;

TivWorld World(TivNoise noise) {
  TivOptions options;
  options.noise = noise;
  options.length_m = 60.0;
  options.euler = false;
  StatusOr<TivWorld> world = TivWorld::Make(options);
  EXPECT_THAT(world, IsOk());
  return *std::move(world);
}

std::vector<TivMineRun> Runs(const TivWorld& world, int count) {
  std::vector<TivMineRun> runs;
  for (int i = 0; i < count; ++i) {
    StatusOr<TivMineRun> run = RunTivMine(world, 100 + static_cast<std::uint64_t>(i));
    EXPECT_THAT(run, IsOk());
    runs.push_back(*std::move(run));
  }
  return runs;
}

// T-IV IX-E: what a static filter believes of the corners that moved drags its pose away.
TEST(TivMine, StaticSlamDivergesAndMultipleHypothesesDoNot) {
  for (const TivNoise noise : {TivNoise::kIdeal, TivNoise::kMatched}) {
    const TivWorld world = World(noise);
    const std::vector<TivMineRun> runs = Runs(world, 5);
    const double multi = MeanOverRuns(runs, &TivMineRun::multi).back().rmse_m;
    EXPECT_GT(MeanOverRuns(runs, &TivMineRun::fixed).back().rmse_m, 3.0 * multi);
    EXPECT_GT(MeanOverRuns(runs, &TivMineRun::reckoning).back().rmse_m, multi);
    for (const TivMineRun& run : runs) {
      EXPECT_FALSE(run.corners.empty());
      for (const TivCorner& corner : run.corners) {
        EXPECT_LT(corner.p_prior, 0.5) << corner.signature;
        EXPECT_FALSE(corner.distance_m > 1.0) << corner.signature;
      }
    }
  }
}

// 15 drives, each on a map of its own: 45 degrees of freedom a step.
TEST(TivMine, PoseIsAsCertainAsItSays) {
  const TivWorld world = World(TivNoise::kIdeal);
  std::vector<TivMineRun> runs;
  for (std::uint64_t seed = 0; seed < 15; ++seed) {
    StatusOr<TreeSlam> mapped = world.MapOriginal(500 + seed);
    ASSERT_THAT(mapped, IsOk());
    StatusOr<TivMineRun> run = RunTivMine(world.WithMap(*std::move(mapped)), 100 + seed);
    ASSERT_THAT(run, IsOk());
    runs.push_back(*std::move(run));
  }
  double nees = 0.0;
  const std::vector<TivMineStep> steps = MeanOverRuns(runs, &TivMineRun::multi);
  for (const TivMineStep& step : steps) nees += step.nees / static_cast<double>(steps.size());
  EXPECT_GT(nees, 2.3);
  EXPECT_LT(nees, 3.7);
}

TEST(TivMine, SameSeedSameDrive) {
  const TivWorld world = World(TivNoise::kIdeal);
  const std::vector<TivMineRun> runs = {Runs(world, 1).front(), Runs(world, 1).front()};
  EXPECT_EQ(runs[0].multi.back().distance_m, runs[1].multi.back().distance_m);
  EXPECT_EQ(ContentHash(runs[0].posterior), ContentHash(runs[1].posterior));
  EXPECT_NE(DrawTivPosterior(world, runs[0]).find("C1.1"), std::string::npos);
}

// Without landmarks that stay nothing corrects a filter that ignores those that move.
TEST(TivRemoval, WithoutLandmarksRejectionIsDeadReckoning) {
  const TivWorld world = World(TivNoise::kIdeal);
  const StatusOr<TivWorld> both = MapBothVersions(world, 7);
  ASSERT_THAT(both, IsOk());
  int corners_twice = 0;
  for (const LandmarkGroup& group : both->mapped().groups())
    corners_twice += group.modes.size() > 1;
  EXPECT_GE(corners_twice, 2);
  const StatusOr<TivRemovalRun> all = RunTivRemoval(*both, 1.0, 8);
  ASSERT_THAT(all, IsOk());
  EXPECT_EQ(all->rejection, all->reckoning);
  EXPECT_LT(all->most_likely, all->rejection);
  EXPECT_LE(all->best_active, all->most_likely);
  const StatusOr<TivRemovalRun> none = RunTivRemoval(*both, 0.0, 8);
  ASSERT_THAT(none, IsOk());
  EXPECT_LT(none->rejection, all->rejection);
  EXPECT_EQ(none->reckoning, all->reckoning);
}

// As a plain filter that is told which landmark it sees.
TEST(StaticSlam, AlwaysUpdatesTheLandmarkOfTheSignature) {
  Calibration calibration;
  calibration.odometry.sd_log_scale = 0.0;
  TreeSlam mapped(TreeSlamOptions(), calibration, std::nullopt);
  mapped.BeginRun({}, calibration, StampFromSeconds(1000.0));
  Observation observation;
  observation.signature = Signature("18");
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {4.0, 0.0};
  for (int i = 0; i < 5; ++i) {
    mapped.Correct({StampFromSeconds(1000.0 + 0.2 * i), {observation}});
  }
  mapped.EndRun();
  SlamState plain = mapped.best().filter.state();
  StaticSlam fixed(StaticPolicy::kAlwaysUpdate, TreeSlamOptions(), mapped);
  StaticSlam decay(StaticPolicy::kAddUngated, TreeSlamOptions(), mapped);
  const PoseWithCovariance start{Se2(), Eigen::Matrix3d::Identity() * 0.01};
  plain.StartFrom(start, calibration);
  fixed.BeginRun(start, calibration);
  decay.BeginRun(start, calibration);
  observation.z = {4.0, 3.0};  // It moved.
  const SlamPair pair{fixed.landmarks().at(observation.signature).front(), &observation};
  plain.Update({&pair, 1});
  fixed.Correct({StampFromSeconds(2000.0), {observation}});
  decay.Correct({StampFromSeconds(2000.0), {observation}});
  EXPECT_LT((fixed.state().pose().Inverse() * plain.pose()).Log().norm(), 1e-12);
  EXPECT_EQ(fixed.landmarks().at(observation.signature).size(), 1u);
  EXPECT_EQ(decay.landmarks().at(observation.signature).size(), 2u);
  EXPECT_LT(decay.state().pose().Log().norm(), 1e-12);
}

}  // namespace
}  // namespace shiftmap
