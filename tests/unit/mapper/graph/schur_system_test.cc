// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/schur_system.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <vector>

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
  for (const ModeIndex m : graph.modes.indices()) {
    EXPECT_LT((graph.modes[m] - other.modes[m]).norm(), 3e-3);
  }
  for (const RunIndex r : graph.runs.indices()) {
    // A few poses see one mode and are free to turn about it: what they see of it is told.
    if (graph.runs[r].poses.size() < 10) continue;
    for (const FrameIndex i : graph.runs[r].poses.indices()) {
      EXPECT_LT((graph.runs[r].poses[i].Inverse() * other.runs[r].poses[i]).Log().norm(), 3e-3);
    }
  }
  const auto seen = [](const Graph& of, const GraphObservation& item) -> Eigen::Vector2d {
    return of.runs[item.run].poses[item.frame].Inverse() * of.modes[item.mode];
  };
  for (const GraphObservation& item : graph.observations) {
    EXPECT_LT((seen(graph, item) - seen(other, item)).norm(), 5e-3);
  }
}

TEST(SchurSystem, FindsTheMinimumOfCeres) {
  for (const int frames : {1, 2, 3, 32, 33, 34, 65, 200}) {
    SCOPED_TRACE(frames);
    Graph graph = MakeCircleGraph({.runs = 1, .frames = frames, .modes = 5}, 7);
    graph.priors = {MakeModesPrior(graph)};
    ExpectSameMinimum(std::move(graph));
  }
}

TEST(SchurSystem, FindsTheMinimumOfCeresWithTheFirstPoseFixed) {
  ExpectSameMinimum(MakeCircleGraph({.runs = 1, .frames = 150, .modes = 8}, 3));
}

TEST(SchurSystem, FindsTheMinimumOfCeresOverSeveralRuns) {
  Graph graph = MakeCircleGraph({.runs = 3, .frames = 70, .modes = 6}, 5);
  graph.priors = {MakeModesPrior(graph)};
  graph.runs[1].variance_factor = 9.0;
  ExpectSameMinimum(std::move(graph));
}

// Every fifth observation is of another place, all on one side.
TEST(SchurSystem, FindsTheMinimumOfCeresBesideOutliersBeyondReach) {
  Graph graph = MakeCircleGraph({.runs = 2, .frames = 70, .modes = 6}, 5);
  graph.priors = {MakeModesPrior(graph)};
  Graph clean = graph;
  clean.observations.clear();
  for (const ObservationIndex i : graph.observations.indices()) {
    GraphObservation& item = graph.observations[i];
    if (i.value() % 5 == 0) {
      item.observation.z.x() += 20.0;
    } else {
      clean.observations.push_back(item);
    }
  }
  graph.loss_reach = 50.0;
  ExpectSameMinimum(graph);
  SolveGraph({50}, &graph);
  SolveGraph({50}, &clean);
  for (const ModeIndex m : graph.modes.indices()) {
    EXPECT_LT((graph.modes[m] - clean.modes[m]).norm(), 3e-3);
  }
}

// One step of a graph with a quadratic cost is all of the way; here the cost is nearly so.
TEST(SchurSystem, TheFixedPoseStays) {
  Graph graph = MakeCircleGraph({.runs = 1, .frames = 50, .modes = 6}, 11);
  const Se2 first = graph.runs[0].poses[0];
  SolveGraph({20}, &graph);
  EXPECT_EQ((first.Inverse() * graph.runs[0].poses[0]).Log().norm(), 0.0);
}

TEST(SchurSystem, TheNumberOfThreadsChangesNoBit) {
  Graph one = MakeCircleGraph({.runs = 3, .frames = 150, .modes = 9}, 19);
  Graph two = one;
  two.threads = 2;
  EXPECT_EQ(SolveGraph({20}, &one).final_cost, SolveGraph({20}, &two).final_cost);
  for (const ModeIndex m : one.modes.indices()) EXPECT_EQ(one.modes[m], two.modes[m]);
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
  for (const ModeIndex m : graph.modes.indices()) {
    EXPECT_LT((moved.modes[m] - alone.modes[m]).norm(), 1e-3);
  }
}

}  // namespace
}  // namespace shiftmap
