// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/open_chain.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace shiftmap {
namespace {

// A vehicle that winds along and sees a mode every few poses.
Graph MakeWay(unsigned seed) {
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  Graph graph;
  graph.open = true;
  GraphRun run;
  run.poses.emplace_back(1.0, -2.0, 0.4);
  for (int i = 0; i < 40; ++i) {
    run.poses.push_back(run.poses.back() * Se2::Exp({0.5, 0.0, 0.3 * uniform(random)}));
  }
  for (int i = 0; i < 40; i += 5) {
    for (int k = 0; k < 3; ++k) {
      GraphObservation item;
      item.frame = FrameIndex(i + k);
      item.mode = graph.modes.end_index();
      graph.observations.push_back(item);
    }
    graph.modes.push_back(run.poses[FrameIndex(i)] *
                          Eigen::Vector2d(3.0 * uniform(random), 3.0 * uniform(random)));
  }
  graph.runs.push_back(std::move(run));
  return graph;
}

GraphStep ZeroStep(const Graph& graph) {
  GraphStep step;
  step.poses.emplace_back(Eigen::VectorXd::Zero(3 * graph.runs[0].poses.end_index()));
  step.calibrations.emplace_back(GraphStep::Calibration::Zero());
  step.modes = Eigen::VectorXd::Zero(2 * graph.modes.end_index());
  return step;
}

double LargestDifference(const Graph& a, const Graph& b) {
  double largest = 0.0;
  for (const FrameIndex i : a.runs[0].poses.indices()) {
    const Se2 difference = a.runs[0].poses[i].Inverse() * b.runs[0].poses[i];
    largest = std::max(largest, difference.Log().norm());
  }
  for (const ModeIndex m : a.modes.indices()) {
    largest = std::max(largest, (a.modes[m] - b.modes[m]).norm());
  }
  return largest;
}

// How far motions, and modes as poses see them, differ between two graphs.
double LargestChangeFromNear(const Graph& a, const Graph& b) {
  double largest = 0.0;
  const IndexedVector<FrameIndex, Se2>& before = a.runs[0].poses;
  const IndexedVector<FrameIndex, Se2>& after = b.runs[0].poses;
  for (FrameIndex i; i + 1 < before.end_index(); ++i) {
    const Se2 motion_before = before[i].Inverse() * before[i + 1];
    const Se2 motion_after = after[i].Inverse() * after[i + 1];
    largest = std::max(largest, (motion_before.Inverse() * motion_after).Log().norm());
  }
  for (const GraphObservation& item : a.observations) {
    const Eigen::Vector2d change = before[item.frame].Inverse() * a.modes[item.mode] -
                                   after[item.frame].Inverse() * b.modes[item.mode];
    largest = std::max(largest, change.norm());
  }
  return largest;
}

TEST(OpenChain, IsApplyToFirstOrder) {
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Graph graph = MakeWay(seed);
    GraphStep step = ZeroStep(graph);
    std::mt19937_64 random(seed);
    std::normal_distribution<double> normal;
    for (double& value : step.poses[0]) value = normal(random);
    for (double& value : step.calibrations[0]) value = normal(random);
    for (double& value : step.modes) value = normal(random);
    const auto difference_at = [&](double length) {
      Graph straight = graph;
      Graph along = graph;
      Apply(Scaled(step, length), &straight);
      OpenChain(graph).Apply(Scaled(step, length), &along);
      EXPECT_EQ(straight.runs[0].correction, along.runs[0].correction);
      EXPECT_EQ(straight.runs[0].sensor_bias, along.runs[0].sensor_bias);
      return LargestDifference(straight, along);
    };
    EXPECT_LT(difference_at(1e-4), 2e-5) << seed;
    EXPECT_NEAR(difference_at(1e-4) / difference_at(0.5e-4), 4.0, 0.1) << seed;
  }
}

TEST(OpenChain, WhatTurnsAsAWholeStaysAsItIs) {
  const double turn = 0.8;
  for (unsigned seed = 1; seed <= 5; ++seed) {
    const Graph graph = MakeWay(seed);
    const IndexedVector<FrameIndex, Se2>& poses = graph.runs[0].poses;
    GraphStep step = ZeroStep(graph);
    // Everything about the origin: left perturbations, seen from each pose.
    for (const FrameIndex i : poses.indices()) {
      step.poses[0].segment<3>(3 * i) = poses[i].InverseAdjoint() * Eigen::Vector3d(0.0, 0.0, turn);
    }
    for (const ModeIndex m : graph.modes.indices()) {
      step.modes.segment<2>(2 * m) =
          turn * Eigen::Vector2d(-graph.modes[m].y(), graph.modes[m].x());
    }
    Graph straight = graph;
    Graph along = graph;
    Apply(step, &straight);
    OpenChain(graph).Apply(step, &along);
    EXPECT_LT(LargestChangeFromNear(graph, along), 1e-9) << seed;
    EXPECT_GT(LargestChangeFromNear(graph, straight), 0.1) << seed;
    const double turned = along.runs[0].poses.back().yaw() - poses.back().yaw();
    EXPECT_NEAR(std::cos(turned), std::cos(turn), 1e-9) << seed;
  }
}

}  // namespace
}  // namespace shiftmap
