// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/run_variances.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <map>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

Eigen::MatrixXd RandomCovariance(Eigen::Index size, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd root =
      Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
  return root * root.transpose() / static_cast<double>(size) +
         0.1 * Eigen::MatrixXd::Identity(size, size);
}

Eigen::VectorXd Draw(const Eigen::MatrixXd& covariance, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::VectorXd noise =
      Eigen::VectorXd::NullaryExpr(covariance.rows(), [&](auto) { return normal(random); });
  return covariance.llt().matrixL() * noise;
}

TEST(DisagreementOf, IsTheSumOfSquares) {
  std::mt19937_64 random(testing::TestSeed(1));
  const Eigen::MatrixXd covariance = RandomCovariance(20, random);
  const Eigen::VectorXd difference = Draw(covariance, random);
  const Disagreement all = DisagreementOf({}, covariance.inverse(), difference, 20.0);
  EXPECT_NEAR(all.squares, difference.dot(covariance.llt().solve(difference)), 1e-8);
  EXPECT_EQ(all.dof, 20.0);
}

// Without the outliers it is the sum of squares of the marginal of the others.
TEST(DisagreementOf, LeavesOutModesThatDifferByThemselves) {
  std::mt19937_64 random(testing::TestSeed(2));
  for (const double scale : {1.0, 4.0}) {  // Also where all differ by more than they should.
    const Eigen::MatrixXd covariance = RandomCovariance(24, random);
    Eigen::VectorXd difference = scale * Draw(covariance, random);
    difference.segment<2>(6) += scale * Eigen::Vector2d(20.0, 0.0);
    difference.segment<2>(18) += scale * Eigen::Vector2d(0.0, -30.0);
    std::vector<Eigen::Index> rows;
    for (Eigen::Index row = 0; row < 24; ++row) {
      if (row / 2 != 3 && row / 2 != 9) rows.push_back(row);
    }
    const Eigen::VectorXd others = difference(rows);
    const Disagreement found = DisagreementOf({}, covariance.inverse(), difference, 24.0);
    EXPECT_EQ(found.dof, 20.0) << scale;
    const Eigen::VectorXd whitened = covariance(rows, rows).llt().solve(others);
    EXPECT_NEAR(found.squares, others.dot(whitened), 1e-6 * found.squares);
    ASSERT_EQ(found.outliers.size(), 2U);
    for (const auto& [m, of_mode] : found.outliers) {
      const std::vector<Eigen::Index> own = {2 * m, 2 * m + 1};
      const Eigen::Vector2d expected = covariance(own, rows) * whitened;
      EXPECT_THAT(of_mode, testing::IsNearMatrix(difference(own) - expected, 1e-6)) << m;
    }
  }
}

TEST(DisagreementOf, WhatIsAnOutlierIsAnOption) {
  const Eigen::MatrixXd information = 1e4 * Eigen::MatrixXd::Identity(24, 24);
  Eigen::VectorXd difference = Eigen::VectorXd::Constant(24, 0.01);
  difference.head<2>().setConstant(0.08);
  const auto outliers = [&](const DisagreementOptions& options) {
    return DisagreementOf(options, information, difference, 24.0).outliers.size();
  };
  EXPECT_EQ(outliers({}), 1u);
  EXPECT_EQ(outliers({.outlier_probability = 1e-40}), 0u);
  EXPECT_EQ(outliers({.expected_mean_square = 100.0}), 0u);
  EXPECT_EQ(outliers({.min_modes = 12}), 0u);
}

TEST(DisagreementOf, KeepsHalfOfTheModes) {
  std::mt19937_64 random(testing::TestSeed(3));
  const Eigen::MatrixXd covariance = RandomCovariance(20, random);
  Eigen::VectorXd difference = Draw(covariance, random);
  for (Eigen::Index m = 0; m < 4; ++m) difference[2 * m] += 1e3 * static_cast<double>(m + 1);
  EXPECT_EQ(DisagreementOf({}, covariance.inverse(), difference, 20.0).dof, 12.0);
  for (Eigen::Index m = 4; m < 10; ++m) difference[2 * m] -= 1e5 * static_cast<double>(m * m);
  EXPECT_GE(DisagreementOf({}, covariance.inverse(), difference, 20.0).dof, 10.0);
}

// Static landmarks, seen often.
OpenWorldOptions StaticWorld(std::uint64_t seed, int runs) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.modes_per_group = 1;
  options.runs = runs;
  options.duration_s = 300.0;
  options.scan_rate_hz = 4.0;
  return options;
}

// NEES per degree of freedom of maps of two runs. Their ranges are wrong for half a minute, each
// landmark's by its own error.
double NeesPerDof(const MapperOptions& mapper, double sd_lasting_m) {
  std::mt19937_64 random(testing::TestSeed(4));
  std::normal_distribution<double> normal;
  testing::MapConsistency maps;
  for (std::uint64_t seed = 301; seed <= 310; ++seed) {
    SimulatedWorld world = testing::Simulate(StaticWorld(seed, 2));
    for (SimulatedRun& run : world.runs) {
      std::map<std::pair<Signature, int>, double> errors;
      for (Scan& scan : run.run.scans) {
        const double at_s = ToSeconds(scan.stamp - run.run.scans.front().stamp);
        for (Observation& observation : scan.observations) {
          const auto key = std::pair(observation.signature, static_cast<int>(at_s / 30.0));
          const auto [error, is_new] = errors.try_emplace(key, 0.0);
          if (is_new) error->second = sd_lasting_m * normal(random);
          observation.z[0] = std::max(0.1, observation.z[0] + error->second);
        }
      }
    }
    maps.Add(testing::MeasureConsistency(
        BuildMap(testing::Inputs(world), std::nullopt, mapper).value().content, world));
  }
  return maps.nees / maps.dof;
}

class EstimateRunVariancesTest : public ::testing::Test {
 protected:
  void SetUp() override {
    mapper_.sd_range_scale = 0.0;  // All sensors know how long a metre is.
    mapper_.sd_run_range_scale = 0.0;
  }

  MapperOptions mapper_;
};

TEST_F(EstimateRunVariancesTest, AMapHasTheErrorsItClaimsWhereNoiseIsAsAssumed) {
  const double nees = NeesPerDof(mapper_, 0.0);
  EXPECT_GT(nees, 0.7);
  EXPECT_LT(nees, 1.3);
}

TEST_F(EstimateRunVariancesTest, AMapHasTheErrorsItClaimsWhereErrorsLast) {
  const double nees = NeesPerDof(mapper_, 0.1);
  EXPECT_GT(nees, 0.4);
  EXPECT_LT(nees, 2.0);
  mapper_.confirmation.max_modes = 0;
  EXPECT_GT(NeesPerDof(mapper_, 0.1), 2.5);  // No variance of runs is estimated then.
}

// How the others differ from a map that a large run made most of tells nothing without that run.
TEST_F(EstimateRunVariancesTest, RunsDoNotDisagreeWithWhatIsNotCompared) {
  constexpr std::size_t kSeenByAll = 30;
  mapper_.confirmation.max_modes = kSeenByAll;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    OpenWorldOptions options = testing::SmallWorld(seed);
    options.groups = 40;
    options.modes_per_group = 1;
    options.runs = 2;
    options.duration_s = 300.0;
    SimulatedWorld world = testing::Simulate(options);
    for (Scan& scan : world.runs[0].run.scans) {
      std::erase_if(scan.observations, [&](const Observation& observation) {
        return !(observation.signature < world.groups[kSeenByAll].signature);
      });
    }
    const MapperResult result = BuildMap(testing::Inputs(world), std::nullopt, mapper_).value();
    EXPECT_EQ(result.runs.size(), 2U) << seed;
    EXPECT_LT(result.disagreement, 1.5) << seed;
  }
}

// As of a map whose first run is left out: another one's start is its frame then.
TEST(MoveBuild, WhatModesDisagreeByTurnsWithThem) {
  BuildState build;
  build.disagreement.of_modes[ModeIndex(1)] = Eigen::Vector2d(4.0, 1.0).asDiagonal();
  MoveBuild(Se2(3.0, 2.0, std::numbers::pi / 2.0), &build);
  const Eigen::Matrix2d expected = Eigen::Vector2d(1.0, 4.0).asDiagonal();
  EXPECT_THAT(build.disagreement.of_modes.at(ModeIndex(1)), testing::IsNearMatrix(expected, 1e-9));
}

// By less than makes another mode.
const Eigen::Vector2d kSmallMove = {0.25, 0.0};

// Some static landmarks stand a little elsewhere in all runs but the first.
SimulatedWorld WorldOfSmallMoves(std::uint64_t seed, int runs, std::size_t moved) {
  SimulatedWorld world = testing::Simulate(StaticWorld(seed, runs));
  for (std::size_t r = 1; r < world.runs.size(); ++r) {
    auto at = world.runs[r].truth.begin();
    for (Scan& scan : world.runs[r].run.scans) {
      while (at->stamp < scan.stamp) ++at;
      for (Observation& observation : scan.observations) {
        for (std::size_t group = 0; group < moved; ++group) {
          if (world.groups[group].signature != observation.signature) continue;
          const Eigen::Vector2d p =
              at->T_map_vehicle * observation.PositionInVehicle() + kSmallMove;
          const Eigen::Vector2d q = at->T_map_vehicle.Inverse() * p;
          observation.z = {q.norm(), std::atan2(q.y(), q.x())};
        }
      }
    }
  }
  return world;
}

// NEES per degree of freedom of maps of two runs.
double NeesOfSmallMoves(const MapperOptions& mapper) {
  testing::MapConsistency maps;
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const SimulatedWorld world = WorldOfSmallMoves(seed, 2, 4);
    maps.Add(testing::MeasureConsistency(
        BuildMap(testing::Inputs(world), std::nullopt, mapper).value().content, world));
  }
  return maps.nees / maps.dof;
}

TEST_F(EstimateRunVariancesTest, DisagreementCountsForLessTheMoreIsKnownBefore) {
  mapper_.disagreement.outlier_probability = 1e-9;  // The moves are no outliers.
  const std::vector<MapperInput> runs = testing::Inputs(WorldOfSmallMoves(1, 2, 4));
  const double disagreement = BuildMap(runs, std::nullopt, mapper_).value().disagreement;
  EXPECT_GT(disagreement, 1.0);
  mapper_.disagreement.prior_dof = 1e6;
  EXPECT_LT(BuildMap(runs, std::nullopt, mapper_).value().disagreement, disagreement);
}

TEST_F(EstimateRunVariancesTest, AMapHasTheErrorsItClaimsWhereLandmarksMovedALittle) {
  EXPECT_LT(NeesOfSmallMoves(mapper_), 2.0);
  mapper_.confirmation.max_modes = 0;
  EXPECT_GT(NeesOfSmallMoves(mapper_), 10.0);  // Nothing is estimated then.
}

// What is added to a covariance is a prior of the next build, which knows better.
TEST_F(EstimateRunVariancesTest, AMapComesToWhereALandmarkMovedALittle) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    SimulatedWorld world = WorldOfSmallMoves(seed, 4, 1);
    const std::vector<MapperInput> runs = testing::Inputs(world);
    world.groups[0].modes[0] += kSmallMove;
    const MapContent first = BuildMap({runs[0], runs[1]}, std::nullopt, mapper_).value().content;
    MapContent map = BuildMap({runs[2]}, first, mapper_).value().content;
    map = BuildMap({runs[3]}, map, mapper_).value().content;
    const auto error = [&](const MapContent& content) {
      return testing::MatchModes(content, world).front().error.norm();
    };
    const auto variance = [](const MapContent& content) {
      return content.groups[0].modes[0].cov_p_map_landmark.trace();
    };
    ASSERT_EQ(map.groups[0].modes.size(), 1U) << seed;
    EXPECT_GT(error(first), 0.08) << seed;
    EXPECT_GT(variance(first), 0.1 * 0.1) << seed;
    EXPECT_LT(error(map), 0.04) << seed;
    EXPECT_LT(variance(map), 0.25 * variance(first)) << seed;
  }
}

// A misread signature is no move: the landmark is known as well as before, and another one does not
// take it along.
TEST_F(EstimateRunVariancesTest, AMisreadSignatureMovesNoLandmark) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    SimulatedWorld world = testing::Simulate(StaticWorld(seed, 3));
    for (std::size_t r = 1; r < 3; ++r) {
      bool is_first = true;
      for (Scan& scan : world.runs[r].run.scans) {
        std::erase_if(scan.observations, [&](Observation& observation) {
          if (observation.signature != world.groups[0].signature) return false;
          observation.z[0] += r == 1 ? 3.0 : 2.0;
          return !std::exchange(is_first, false);
        });
      }
      ASSERT_FALSE(is_first) << seed;
    }
    const std::vector<MapperInput> runs = testing::Inputs(world);
    std::optional<MapContent> map;
    for (const MapperInput& run : runs) {
      const std::optional<MapContent> before = map;
      map = BuildMap({run}, map, mapper_).value().content;
      if (!before) continue;
      ASSERT_EQ(map->groups[0].modes.size(), 1U) << seed;
      EXPECT_LT(map->groups[0].modes[0].cov_p_map_landmark.trace(),
                1.5 * before->groups[0].modes[0].cov_p_map_landmark.trace())
          << seed;
      EXPECT_LT((map->groups[0].modes[0].p_map_landmark - before->groups[0].modes[0].p_map_landmark)
                    .norm(),
                0.2)
          << seed;
    }
  }
}

}  // namespace
}  // namespace shiftmap
