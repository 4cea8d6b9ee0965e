// SPDX-License-Identifier: Apache-2.0
#include "mapper/covariance/mode_covariance.h"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "mapper/covariance/gauge.h"
#include "mapper/graph/graph_posterior.h"
#include "tests/support/circle_graph.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

// Runs along a corridor with `modes` landmarks on either side.
Graph Corridor(int modes, int runs = 1) {
  std::mt19937_64 random(testing::TestSeed(81));
  std::normal_distribution<double> normal;
  Graph graph;
  for (int m = 0; m < modes; ++m) {
    graph.modes.emplace_back(0.5 * m, m % 2 == 0 ? 2.0 : -2.0);
  }
  GraphRun run;
  const int frames = modes / 2;
  for (int f = 0; f < frames; ++f) {
    run.poses.emplace_back(1.0 * f, 0.0, 0.0);
    if (f + 1 == frames) break;
    MotionIncrement motion;
    motion.T_begin_end = Se2(1.0, 0.0, 0.0);
    motion.cov = Eigen::Vector3d(4e-4, 4e-4, 1e-4).asDiagonal();
    motion.J_calibration(0, 0) = 1.0;
    run.motions.push_back(motion);
  }
  graph.runs.assign(static_cast<std::size_t>(runs), run);
  for (int f = 0; f < runs * frames; ++f) {
    const int frame = f % frames;
    for (int m = std::max(0, 2 * frame - 1); m < std::min(modes, 2 * frame + 8); ++m) {
      const Eigen::Vector2d q = run.poses[FrameIndex(frame)].Inverse() * graph.modes[ModeIndex(m)];
      Observation observation;
      observation.z = {q.norm() + 0.05 * normal(random), std::atan2(q.y(), q.x())};
      graph.observations.push_back({RunIndex(f / frames),
                                    FrameIndex(frame),
                                    ModeIndex(m),
                                    observation,
                                    Eigen::Vector2d(2.5e-3, 4e-4).asDiagonal(),
                                    0.1});
    }
  }
  return graph;
}

TEST(ModeCovariance, TilesHoldEveryModeOnceAndNeighboursTogether) {
  IndexedVector<ModeIndex, Eigen::Vector2d> positions;
  for (int i = 0; i < 40; ++i) positions.emplace_back(i, 0.1 * (i % 3));
  std::set<ModeIndex> seen;
  for (const std::vector<ModeIndex>& tile : TileModes(positions, 8)) {
    EXPECT_LE(tile.size(), 8u);
    EXPECT_EQ(tile.back() - tile.front() + 1, std::ssize(tile));
    for (const ModeIndex mode : tile) EXPECT_TRUE(seen.insert(mode).second);
  }
  EXPECT_EQ(seen.size(), 40u);
}

TEST(ModeCovariance, BlocksOfALargeMapAreThoseOfTheDenseCovariance) {
  const Graph graph = Corridor(kMaxJointModes + 60);
  constexpr double kScale = 0.02;
  const auto posterior = LinearizeForMap(graph);
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  Eigen::MatrixXd distortion(2 * graph.modes.end_index(), 3);
  for (double& value : distortion.reshaped()) value = 0.01 * normal(random);
  const JointCovariance blocks = MapCovariance(graph, *posterior, kScale, distortion, {});
  const Eigen::MatrixXd dense =
      AddScaleUncertainty(graph.modes,
                          kScale,
                          ReferToPositions(graph.modes,
                                           LinearizeGraph(graph)->ModeCovariance() +
                                               distortion * distortion.transpose()));
  for (int i = 0; i < blocks.size(); ++i) {
    const Eigen::Matrix2d wanted = dense.block<2, 2>(2 * i, 2 * i);
    EXPECT_THAT(blocks.Block(i, i), testing::IsNearMatrix(wanted, 1e-6 * wanted.norm())) << i;
  }
  EXPECT_GT(blocks.cross_blocks().size(), 10u * graph.modes.size());
  for (const JointCovariance::CrossBlock& block : blocks.cross_blocks()) {
    const Eigen::Matrix2d wanted = dense.block<2, 2>(2 * block.row, 2 * block.column);
    EXPECT_LT((block.value - wanted).norm(), 1e-6 * dense.norm()) << block.row;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(blocks.Dense());
  EXPECT_GT(solver.eigenvalues().minCoeff(), 0.0);
}

// The minimum weighs prior and runs by covariances P₀ and P₁; the runs' errors have F P₁.
TEST(ModeCovariance, DisagreementIsOfTheRunsAndNotOfThePrior) {
  constexpr double kDisagreement = 5.0;
  Graph graph = Corridor(20);
  for (const bool with_prior : {false, true}) {
    if (with_prior) graph.priors = {testing::MakeModesPrior(graph)};
    const auto posterior = LinearizeForMap(graph);
    const Eigen::MatrixXd P = posterior->ModeCovariance();
    Eigen::MatrixXd expected = kDisagreement * P;
    if (with_prior) {
      const Eigen::MatrixXd prior = graph.priors.front().information;
      const Eigen::MatrixXd of_runs = P.inverse() - prior;
      expected = P * (prior + kDisagreement * of_runs) * P;
    }
    expected = ReferToPositions(graph.modes, expected);
    EXPECT_THAT(MapCovariance(graph, *posterior, {}, {}, {kDisagreement, {}}).Dense(),
                testing::IsNearMatrix(expected, 1e-6 * expected.norm()));
  }
}

TEST(ModeCovariance, DifferencesAreThoseOfTheJointCovarianceAndBounded) {
  const Graph graph = Corridor(kMaxJointModes + 60);
  GraphSolver solver;
  const ModeDifferences sparse = ModeDifferences::Of(graph, &solver).value();
  const Eigen::MatrixXd joint = LinearizeGraph(graph)->ModeCovariance();
  using Pair = std::pair<ModeIndex, ModeIndex>;
  for (const auto& [a, b] : {Pair(0, 1), Pair(5, 300), Pair(200, 204), Pair(358, 359)}) {
    SCOPED_TRACE(a.value());
    Eigen::MatrixXd difference = Eigen::MatrixXd::Zero(2, joint.cols());
    difference.middleCols<2>(2 * a).setIdentity();
    difference.middleCols<2>(2 * b) = -Eigen::Matrix2d::Identity();
    const Eigen::Matrix2d wanted = difference * joint * difference.transpose();
    EXPECT_LT((sparse.Covariance(a, b) - wanted).norm(), 1e-6 * wanted.norm());
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> above(sparse.MaxCovariance(a, b) - wanted);
    EXPECT_GT(above.eigenvalues().minCoeff(), 0.0);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> below(wanted - sparse.MinCovariance(a, b));
    EXPECT_GT(below.eigenvalues().minCoeff(), 0.0);
  }
}

}  // namespace
}  // namespace shiftmap
