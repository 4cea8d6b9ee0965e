// SPDX-License-Identifier: Apache-2.0
#include "mapper/registration/confirm_alignment.h"

#include <gtest/gtest.h>

#include <vector>

#include "mapper/calibration/distortion_calibration.h"
#include "mapper/covariance/gauge.h"
#include "mapper/run_maps/single_run.h"
#include "tests/support/geometry_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

constexpr double kArea = 100.0;

const std::vector<Eigen::Vector2d> kPlaces = {{0.0, 0.0},
                                              {1.0, 0.2},
                                              {0.3, 1.1},
                                              {1.4, 1.3},
                                              {0.7, 2.2},
                                              {6.0, 0.5},
                                              {7.1, 3.4},
                                              {5.2, 6.4},
                                              {8.3, 8.9}};

// Of a landmark in each of the places, the first `moved` displaced by `by`.
AlignmentPoints Points(std::size_t moved, const Eigen::Vector2d& by, double sd_m) {
  AlignmentPoints points;
  for (std::size_t i = 0; i < kPlaces.size(); ++i) {
    points.push_back({GroupIndex(i),
                      kPlaces[i] + (i < moved ? by : Eigen::Vector2d::Zero()),
                      sd_m * sd_m * Eigen::Matrix2d::Identity()});
  }
  return points;
}

bool NeedsConfirmation(const AlignmentPoints& points) {
  const MapperOptions options;
  RunMap run_map;
  run_map.points = points;
  const AlignmentPoints reference = Points(0, Eigen::Vector2d::Zero(), 0.01);
  const std::optional<Alignment> consensus =
      AlignByConsensus(reference, run_map.points, kArea, options.alignment);
  return ConsensusPlace(options, reference, kArea, run_map, consensus).NeedsConfirmation();
}

TEST(NeedsConfirmation, MostThatAgreeAreEnough) {
  EXPECT_FALSE(NeedsConfirmation(Points(0, Eigen::Vector2d::Zero(), 0.01)));
  EXPECT_FALSE(NeedsConfirmation(Points(2, {1.0, 0.5}, 0.01)));
}

// Which of two bodies stayed: more than half agree if it was the larger one.
TEST(NeedsConfirmation, AnotherBodyMayHaveStayed) {
  EXPECT_TRUE(NeedsConfirmation(Points(5, {1.0, 0.5}, 0.01)));
  EXPECT_TRUE(NeedsConfirmation(Points(4, {1.0, 0.5}, 0.01)));
  EXPECT_TRUE(NeedsConfirmation(Points(3, {1.0, 0.5}, 0.01)));
}

TEST(NeedsConfirmation, ADeformedRunShowsNoBodies) {
  EXPECT_FALSE(NeedsConfirmation(Points(4, {1.0, 0.5}, 0.2)));
}

TEST(NeedsConfirmation, WithoutAConsensusItDoes) { EXPECT_TRUE(NeedsConfirmation({})); }

RunMap MapOneRun(const SimulatedWorld& world, const MappingRun& run) {
  const MapperOptions options;
  return MakeUndistortedRunMap(options, MapSingleRun(run, world.groups.size(), options)).value();
}

// 150 landmarks with three modes each, twelve of which a run sees: half at their first mode, the
// others at none.
TEST(ExplainRunMap, IsOfTheLandmarksInCommon) {
  constexpr std::size_t kBefore = 138;
  const SimulatedWorld world = testing::StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  RunMap run_map = MapOneRun(world, run);
  for (AlignmentPoint& point : run_map.points)
    point.group = GroupIndex(kBefore) + point.group.value();

  BuildState map = StartBuild(kBefore + world.groups.size(), {});
  for (std::size_t group = 0; group < map.modes.size(); ++group) {
    const bool seen = group >= kBefore;
    const Eigen::Vector2d place = seen ? world.groups[group - kBefore].modes.front()
                                       : Eigen::Vector2d(0.1 * static_cast<double>(group), -5.0);
    const bool moved = group % 2 == 0;
    for (const Eigen::Vector2d& by : {Eigen::Vector2d(moved ? 1.5 : 0.0, moved ? 0.8 : 0.0),
                                      Eigen::Vector2d(-1.1, 2.3),
                                      Eigen::Vector2d(2.6, -1.7)}) {
      const Se2 turn(0.0, 0.0, static_cast<double>(group));
      map.modes[GroupIndex(group)].push_back({place + turn * by, ModeNumber(1)});
    }
  }
  const FlatModes flat(map);
  MapContent prior;
  prior.covariance = JointCovariance(
      std::vector<Eigen::Matrix2d>(flat.count(), 4e-4 * Eigen::Matrix2d::Identity()), {});
  const std::optional<Explanations> explanations =
      ExplainRunMap(MapperOptions(), prior, map, 200.0, run_map);
  ASSERT_TRUE(explanations);
  const Explanation& best = explanations->frames.front();
  EXPECT_GT(best.probability, 0.99);
  EXPECT_GE(best.stayed.size(), 5);
  for (const Match& match : best.stayed) {
    const AlignmentPoint& point = run_map.points[match.other];
    EXPECT_EQ(match.reference, flat.Index(point.group, 0));
    const Eigen::Vector2d& place =
        world.groups[static_cast<std::size_t>(point.group.value()) - kBefore].modes.front();
    EXPECT_LT((best.alignment.T_reference_other * point.position - place).norm(), 0.15);
  }
}

// The oracle: those of all modes.
TEST(CovarianceOfModes, IsThatOfAllRelativeToTheChosen) {
  const SimulatedWorld world = testing::StaticWorld(3);
  const MappingRun run = testing::Arrange(world, world.runs[0].run);
  RunMap run_map = MapOneRun(world, run);
  const std::vector<ModeIndex> chosen = {1, 4, 5, 9};
  const Eigen::MatrixXd some = CovarianceOfModes(MapperOptions(), chosen, &run_map.build).value();
  std::vector<Eigen::Vector2d> positions;
  Eigen::MatrixXd expected(8, 8);
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    positions.push_back(run_map.points[chosen[i]].position);
    for (std::size_t j = 0; j < chosen.size(); ++j) {
      expected.block<2, 2>(static_cast<Eigen::Index>(2 * i), static_cast<Eigen::Index>(2 * j)) =
          run_map.covariance.block<2, 2>(2 * chosen[i], 2 * chosen[j]);
    }
  }
  constexpr double kFloors = 1e-6;  // Of both, of a millimetre each. [m²]
  EXPECT_LT((ReferToPositions(positions, expected) - some).cwiseAbs().maxCoeff(), 2.0 * kFloors);
  EXPECT_GT(some.trace(), 100.0 * kFloors);
  EXPECT_GT(run_map.build.distortion_root.norm(), 0.0);

  // Without distortions too.
  DropDistortions(&run_map.build);
  const Eigen::MatrixXd all = RunMapCovariance(MapperOptions(), &run_map.build).value();
  std::vector<ModeIndex> every;
  for (const ModeIndex mode : run_map.points.indices()) every.push_back(mode);
  EXPECT_THAT(CovarianceOfModes(MapperOptions(), every, &run_map.build).value(),
              testing::IsNearMatrix(all, 1e-9));
}

}  // namespace
}  // namespace shiftmap
