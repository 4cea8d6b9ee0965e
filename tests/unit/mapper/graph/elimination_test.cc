// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <optional>
#include <random>
#include <vector>

#include "mapper/graph/rest_system.h"
#include "tests/support/circle_graph.h"

namespace shiftmap {
namespace {

using testing::MakeCircleGraph;
using testing::MakeModesPrior;

// The same minimum, from the same start, as Ceres' trust region finds.
void ExpectSameMinimum(Graph graph) {
  Graph other = graph;
  const GraphSummary ours = SolveGraph({50}, &graph);
  const GraphSummary ceres = SolveGraphByCeres({200}, &other);
  EXPECT_TRUE(ours.converged);
  EXPECT_NEAR(ours.final_cost, ceres.final_cost, 2e-5 * ceres.final_cost + 1e-12);
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    EXPECT_LT((graph.modes[m] - other.modes[m]).norm(), 3e-3);
  }
  for (std::size_t r = 0; r < graph.runs.size(); ++r) {
    // A few poses see one mode and are free to turn about it: what they see of it is told.
    if (graph.runs[r].poses.size() < 10) continue;
    for (std::size_t i = 0; i < graph.runs[r].poses.size(); ++i) {
      EXPECT_LT((graph.runs[r].poses[i].Inverse() * other.runs[r].poses[i]).Log().norm(), 3e-3);
    }
  }
  const auto seen = [](const Graph& of, const GraphObservation& item) -> Eigen::Vector2d {
    const std::vector<Se2>& poses = of.runs[static_cast<std::size_t>(item.run)].poses;
    return poses[static_cast<std::size_t>(item.frame)].Inverse() *
           of.modes[static_cast<std::size_t>(item.mode)];
  };
  for (const GraphObservation& item : graph.observations) {
    EXPECT_LT((seen(graph, item) - seen(other, item)).norm(), 5e-3);
  }
}

TEST(GraphElimination, FindsTheMinimumOfCeres) {
  for (const int frames : {1, 2, 3, 32, 33, 34, 65, 200}) {
    SCOPED_TRACE(frames);
    Graph graph = MakeCircleGraph({.runs = 1, .frames = frames, .modes = 5}, 7);
    graph.priors = {MakeModesPrior(graph)};
    ExpectSameMinimum(std::move(graph));
  }
}

TEST(GraphElimination, FindsTheMinimumOfCeresWithTheFirstPoseHeld) {
  ExpectSameMinimum(MakeCircleGraph({.runs = 1, .frames = 150, .modes = 8}, 3));
}

TEST(GraphElimination, FindsTheMinimumOfCeresOverSeveralRuns) {
  Graph graph = MakeCircleGraph({.runs = 3, .frames = 70, .modes = 6}, 5);
  graph.priors = {MakeModesPrior(graph)};
  ExpectSameMinimum(std::move(graph));
}

// Every fifth observation is of another place, all on one side.
TEST(GraphElimination, FindsTheMinimumOfCeresBesideOutliersBeyondReach) {
  Graph graph = MakeCircleGraph({.runs = 2, .frames = 70, .modes = 6}, 5);
  graph.priors = {MakeModesPrior(graph)};
  Graph clean = graph;
  clean.observations.clear();
  for (std::size_t i = 0; i < graph.observations.size(); ++i) {
    GraphObservation& item = graph.observations[i];
    if (i % 5 == 0) {
      item.observation.z.x() += 20.0;
    } else {
      clean.observations.push_back(item);
    }
  }
  graph.loss_reach = 50.0;
  ExpectSameMinimum(graph);
  SolveGraph({50}, &graph);
  SolveGraph({50}, &clean);
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    EXPECT_LT((graph.modes[m] - clean.modes[m]).norm(), 3e-3);
  }
}

// One step of a graph with a quadratic cost is all of the way; here the cost is nearly so.
TEST(GraphElimination, HeldPoseStays) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 50, .modes = 6}, 11);
  const Se2 first = graph.runs[0].poses[0];
  SolveGraph({20}, &graph);
  EXPECT_EQ((first.Inverse() * graph.runs[0].poses[0]).Log().norm(), 0.0);
}

TEST(GraphElimination, DrawsHaveTheCovariance) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 80, .modes = 4}, 13);
  graph.priors = {MakeModesPrior(graph)};
  SolveGraph({30}, &graph);
  GraphElimination elimination(graph);
  ASSERT_TRUE(elimination.Linearize());
  const Eigen::MatrixXd covariance = elimination.ModeCovariance();
  std::mt19937_64 random(1);
  constexpr int kDraws = 4000;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(covariance.rows(), covariance.cols());
  for (const ResidualDraw& draw : elimination.DrawResiduals(kDraws, random)) {
    sum += draw.step.modes * draw.step.modes.transpose() / kDraws;
  }
  // Six standard deviations of a variance's estimate.
  EXPECT_LT((sum - covariance).cwiseAbs().maxCoeff(),
            6.0 * std::sqrt(2.0 / kDraws) * covariance.diagonal().maxCoeff());
}

TEST(GraphElimination, DifferencesOfModesHaveTheJointCovariances) {
  Graph graph = MakeCircleGraph({.runs = 2, .frames = 80, .modes = 6}, 17);
  graph.priors = {MakeModesPrior(graph)};
  GraphElimination elimination(graph);
  ASSERT_TRUE(elimination.Linearize());
  const Eigen::MatrixXd covariance = elimination.ModeCovariance();
  for (int a = 0; a < 6; ++a) {
    for (int b = a + 1; b < 6; ++b) {
      const Eigen::Matrix2d wanted =
          covariance.block<2, 2>(2 * a, 2 * a) + covariance.block<2, 2>(2 * b, 2 * b) -
          covariance.block<2, 2>(2 * a, 2 * b) - covariance.block<2, 2>(2 * b, 2 * a);
      EXPECT_LT((elimination.ModeDifferenceCovariance(a, b) - wanted).norm(), 1e-9 * wanted.norm());
    }
  }
}

TEST(GraphElimination, TheNumberOfThreadsChangesNoBit) {
  Graph one = MakeCircleGraph({.runs = 3, .frames = 150, .modes = 9}, 19);
  Graph two = one;
  two.threads = 2;
  EXPECT_EQ(SolveGraph({20}, &one).final_cost, SolveGraph({20}, &two).final_cost);
  for (std::size_t m = 0; m < one.modes.size(); ++m) EXPECT_EQ(one.modes[m], two.modes[m]);
}

// Three runs whose small system is too large for a dense factor, so that factors are kept.
TEST(GraphSolver, WhatItKeepsChangesTheAnswerByNothingThatMatters) {
  Graph graph = MakeCircleGraph({.runs = 3, .frames = 1500, .modes = 9}, 23);
  GraphSolver solver;
  solver.Solve({30}, &graph);
  Graph moved = graph;
  for (Eigen::Vector2d& mode : moved.modes) mode += Eigen::Vector2d(0.02, -0.01);
  Graph alone = moved;
  const GraphSummary kept = solver.Solve({30}, &moved);
  const GraphSummary fresh = SolveGraph({30}, &alone);
  EXPECT_TRUE(kept.converged);
  EXPECT_NEAR(kept.final_cost, fresh.final_cost, 1e-6 * fresh.final_cost);
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    EXPECT_LT((moved.modes[m] - alone.modes[m]).norm(), 1e-3);
  }
}

Eigen::MatrixXd RandomInformation(Eigen::Index size, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::MatrixXd A =
      Eigen::MatrixXd::NullaryExpr(size, size, [&](auto, auto) { return normal(random); });
  return A * A.transpose() + Eigen::MatrixXd::Identity(size, size);
}

// A chain of overlapping blocks, small enough for the dense factor and too large for it.
TEST(RestSystem, SolvesLikeADenseMatrix) {
  for (const int size : {9, 42, 600}) {
    std::mt19937_64 random(17);
    RestSystem rest(size);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(size);
    for (int first = 0; first + 6 <= size; first += 3) {
      const Eigen::MatrixXd block = RandomInformation(6, random);
      const Eigen::VectorXd right = block.col(0);
      rest.Add({first + 3, first + 4, first + 5, first, first + 1, first + 2}, block, right);
      std::vector<int> order = {first + 3, first + 4, first + 5, first, first + 1, first + 2};
      for (int i = 0; i < 6; ++i) {
        b[order[static_cast<std::size_t>(i)]] += right[i];
        for (int j = 0; j < 6; ++j) {
          H(order[static_cast<std::size_t>(i)], order[static_cast<std::size_t>(j)]) += block(i, j);
        }
      }
    }
    ASSERT_TRUE(rest.Factorize());
    const Eigen::MatrixXd covariance = H.inverse();
    EXPECT_LT((rest.Solve() - covariance * b).norm(), 1e-8 * (1.0 + b.norm()));
    EXPECT_LT((rest.TailCovariance(6) - covariance.bottomRightCorner(6, 6)).norm(), 1e-9);
    // L⁻ᵀ of all unit vectors is a square root of the covariance.
    Eigen::MatrixXd root(size, size);
    for (int i = 0; i < size; ++i)
      root.col(i) = rest.DrawTail(size, Eigen::VectorXd::Unit(size, i));
    EXPECT_LT((root * root.transpose() - covariance).norm(), 1e-8);
  }
}

// A ring of overlapping blocks, each `factor` times its random information.
void AddRing(int size, const std::vector<double>& factors, RestSystem* rest) {
  std::mt19937_64 random(29);
  rest->Clear();
  for (int first = 0; first < size; first += 3) {
    std::vector<int> index;
    for (int i = 0; i < 6; ++i) index.push_back((first + i) % size);
    const Eigen::MatrixXd block = RandomInformation(6, random);
    const double factor = factors[static_cast<std::size_t>(first / 3) % factors.size()];
    rest->Add(index, factor * block, block.col(0));
  }
}

// Another system than that of the factor: near it, far from it, and of another shape.
TEST(RestSystem, SolvesSimilarSystemsOnAnOldFactor) {
  constexpr int kSize = 600;
  RestSystem rest(kSize);
  AddRing(kSize, {1.0}, &rest);
  ASSERT_TRUE(rest.SolveSimilar());
  for (const std::vector<double>& factors :
       {std::vector<double>{1.0, 1.02, 0.97}, {1.0, 1e4, 1e-3}, {1.0, 1.01}}) {
    AddRing(kSize, factors, &rest);
    const std::optional<Eigen::VectorXd> similar = rest.SolveSimilar();
    ASSERT_TRUE(similar);
    RestSystem exact(kSize);
    AddRing(kSize, factors, &exact);
    ASSERT_TRUE(exact.Factorize());
    EXPECT_LT((*similar - exact.Solve()).norm(), 1e-5 * exact.Solve().norm());
  }
  AddRing(kSize, {1.0, -1.0}, &rest);
  EXPECT_FALSE(rest.SolveSimilar());
}

TEST(RestSystem, LeavesOutHeldRowsAndSaysWhatIsNotDetermined) {
  RestSystem rest(2);
  rest.Add({-1, 1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  EXPECT_FALSE(rest.Factorize());
  RestSystem whole(2);
  whole.Add({0, -1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  whole.Add({-1, 1}, Eigen::Matrix2d{{5.0, 1.0}, {1.0, 2.0}}, Eigen::Vector2d(3.0, 4.0));
  ASSERT_TRUE(whole.Factorize());
  EXPECT_NEAR(whole.Solve()[0], 0.6, 1e-12);
  EXPECT_NEAR(whole.Solve()[1], 2.0, 1e-12);
}

}  // namespace
}  // namespace shiftmap
