// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/fixed_lag_smoother.h"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "mapper/graph/graph_posterior.h"
#include "tests/support/geometry_matchers.h"
#include "tests/unit/tools/experiment/incremental/small_site.h"

namespace shiftmap {
namespace {

using testing::AddModes;
using testing::AddNextFrame;
using testing::IsNearMatrix;
using testing::IsNearPose;
using testing::MakeSmallSite;
using testing::OptionsOf;
using testing::SiteShape;
using testing::StartOf;

// The batch's minimum, closer than one call stops.
Graph Solved(Graph graph) {
  for (int i = 0; i < 20; ++i) SolveGraph({5}, &graph);
  return graph;
}

FixedLagSmoother RunThrough(const SiteShape& shape, const Graph& graph, int window_frames) {
  FixedLagSmoother smoother(OptionsOf(graph), StartOf(shape, graph));
  AddModes(graph, &smoother);
  for (int f = 0; f < shape.frames; ++f) {
    AddNextFrame(graph, f, &smoother);
    EXPECT_TRUE(smoother.Solve());
    smoother.DropBefore(static_cast<int>(smoother.window().frames.size()) - window_frames);
  }
  return smoother;
}

TEST(FixedLagSmootherTest, WithAllFramesItIsTheBatch) {
  const SiteShape shape;
  const Graph graph = MakeSmallSite(shape, 1);
  FixedLagSmoother smoother = RunThrough(shape, graph, shape.frames);
  ASSERT_TRUE(smoother.SolveFully());
  const Graph batch = Solved(graph);
  ASSERT_EQ(smoother.window().frames.size(), 60u);
  for (std::size_t f = 0; f < 60; ++f) {
    EXPECT_THAT(smoother.window().frames[f].T_map_vehicle,
                IsNearPose(batch.runs[0].poses[FrameIndex(f)], 1e-6));
  }
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    EXPECT_THAT(smoother.window().modes[m].p_map_landmark,
                IsNearMatrix(batch.modes[ModeIndex(m)], 1e-6));
  }
  CalibrationVector calibration;
  calibration << batch.runs[0].correction, batch.runs[0].sensor_bias;
  EXPECT_THAT(smoother.window().calibration, IsNearMatrix(calibration, 1e-6));
}

TEST(FixedLagSmootherTest, StepsStayNearTheBatchWithoutSolvingFully) {
  const SiteShape shape;
  const Graph graph = MakeSmallSite(shape, 2);
  const FixedLagSmoother smoother = RunThrough(shape, graph, shape.frames);
  const Graph batch = Solved(graph);
  // Beside a standard deviation of centimetres.
  EXPECT_THAT(smoother.newest().T_map_vehicle, IsNearPose(batch.runs[0].poses.back(), 1e-3));
}

TEST(FixedLagSmootherTest, CovariancesAreThoseOfTheBatch) {
  const SiteShape shape;
  const Graph graph = MakeSmallSite(shape, 3);
  FixedLagSmoother smoother = RunThrough(shape, graph, shape.frames);
  ASSERT_TRUE(smoother.SolveFully());
  const Graph solved = Solved(graph);
  const Eigen::MatrixXd expected = LinearizeGraph(solved)->ModeCovariance();
  EXPECT_THAT(smoother.ModePairCovariance(1, 2), IsNearMatrix(expected.block<4, 4>(2, 2), 1e-7));
  EXPECT_THAT(smoother.PoseModeCovariance(4).bottomRightCorner(2, 2),
              IsNearMatrix(expected.block<2, 2>(8, 8), 1e-7));
}

// With noise so small that everything is linear, a window loses nothing.
TEST(FixedLagSmootherTest, LinearWindowIsTheBatch) {
  SiteShape shape;
  shape.noise = 1e-5;
  const Graph graph = MakeSmallSite(shape, 4);
  const FixedLagSmoother smoother = RunThrough(shape, graph, 10);
  EXPECT_LE(smoother.window().frames.size(), 18u);
  const Graph batch = Solved(graph);
  const Se2 truth_scale = graph.runs[0].poses.back();
  const double correction =
      (truth_scale.translation() - batch.runs[0].poses.back().translation()).norm();
  ASSERT_GT(correction, 1e-7);
  EXPECT_THAT(smoother.newest().T_map_vehicle,
              IsNearPose(batch.runs[0].poses.back(), 1e-4 * correction));
  for (std::size_t m = 0; m < graph.modes.size(); ++m) {
    EXPECT_THAT(smoother.window().modes[m].p_map_landmark,
                IsNearMatrix(batch.modes[ModeIndex(m)], 1e-4 * correction));
  }
}

// Relative observations do not tell where the map is or how it is turned, however long they go on.
TEST(FixedLagSmootherTest, DroppedFramesDoNotMakeTheMapFrameKnown) {
  SiteShape shape;
  shape.frames = 150;
  shape.surveyed = false;
  shape.start_sd = 0.2;
  shape.noise = 2.0;
  const Graph graph = MakeSmallSite(shape, 5);
  const FixedLagSmoother smoother = RunThrough(shape, graph, 10);
  // Of the mode, turning the map by α about the start moves it by α × its distance; of the yaw all
  // is the start's, and more.
  const Eigen::Matrix<double, 5, 5> cov = smoother.PoseModeCovariance(0);
  EXPECT_GE(std::sqrt(cov(2, 2)), 0.2 * (1.0 - 1e-6));
}

TEST(FixedLagSmootherTest, AWindowedRunIsNearTheBatch) {
  const SiteShape shape{.frames = 150};
  const Graph graph = MakeSmallSite(shape, 6);
  const FixedLagSmoother smoother = RunThrough(shape, graph, 20);
  const Graph batch = Solved(graph);
  EXPECT_THAT(smoother.newest().T_map_vehicle, IsNearPose(batch.runs[0].poses.back(), 0.01));
}

TEST(FixedLagSmootherTest, SwitchedObservationsAreThoseOfTheOtherMode) {
  const SiteShape shape;
  Graph graph = MakeSmallSite(shape, 7);
  FixedLagSmoother smoother = RunThrough(shape, graph, shape.frames);
  const int other = smoother.AddMode({0.0, 0.0}, Eigen::Matrix2d::Identity());
  graph.modes.emplace_back(0.0, 0.0);
  for (GraphObservation& item : graph.observations) {
    if (item.frame >= 30 && item.mode == 2) item.mode = ModeIndex(other);
  }
  for (int f = 30; f < shape.frames; ++f) {
    const WindowFrame& frame = smoother.window().frames[static_cast<std::size_t>(f)];
    for (int i = 0; i < static_cast<int>(frame.observations.size()); ++i) {
      const int mode = frame.observations[static_cast<std::size_t>(i)].mode;
      if (mode == 2) smoother.Switch(f, i, other);
    }
  }
  ASSERT_TRUE(smoother.SolveFully());
  const Graph batch = Solved(graph);
  EXPECT_THAT(smoother.window().modes.back().p_map_landmark,
              IsNearMatrix(batch.modes.back(), 1e-6));
  EXPECT_THAT(smoother.window().modes[2].p_map_landmark, IsNearMatrix(batch.modes[2], 1e-6));
}

// Half of the sightings of a landmark make a mode of their own, which then turns out to be the
// same: the result is that of a graph which never had two.
void ExpectMergedEqualsOne(int window_frames, double noise, double tolerance) {
  SiteShape shape;
  shape.noise = noise;
  const Graph graph = MakeSmallSite(shape, 8);
  FixedLagSmoother smoother(OptionsOf(graph), StartOf(shape, graph));
  AddModes(graph, &smoother);
  Graph split = graph;
  const int duplicate = smoother.AddMode(graph.modes[1], Eigen::Matrix2d::Identity());
  for (const ObservationIndex i : split.observations.indices()) {
    ModeIndex& mode = split.observations[i].mode;
    if (mode == 1 && i.value() % 2 == 0) mode = ModeIndex(duplicate);
  }
  for (int f = 0; f < shape.frames; ++f) {
    AddNextFrame(split, f, &smoother);
    ASSERT_TRUE(smoother.Solve());
    smoother.DropBefore(static_cast<int>(smoother.window().frames.size()) - window_frames);
  }
  smoother.MergeModes(duplicate, 1);
  ASSERT_TRUE(smoother.SolveFully());
  const Graph batch = Solved(graph);
  EXPECT_THAT(smoother.window().modes[1].p_map_landmark, IsNearMatrix(batch.modes[1], tolerance));
  EXPECT_THAT(smoother.newest().T_map_vehicle, IsNearPose(batch.runs[0].poses.back(), tolerance));
}

TEST(FixedLagSmootherTest, MergedModesAreOne) { ExpectMergedEqualsOne(1000, 1.0, 1e-6); }

TEST(FixedLagSmootherTest, MergedModesAreOneInWhatWasDropped) {
  ExpectMergedEqualsOne(10, 1e-5, 1e-9);
}

}  // namespace
}  // namespace shiftmap
