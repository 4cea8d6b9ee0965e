// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/incremental_mapper.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "mapper/graph/graph.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/tools/experiment/incremental/small_site.h"

namespace shiftmap {
namespace {

using testing::IsNearPose;
using testing::IsOk;
using testing::StatusIs;

constexpr double kRangeSd = 0.05;
constexpr double kBearingSd = 0.01;
constexpr double kSurveySd = 0.03;

// Four landmarks around a vehicle that drives circles and sees those in front of it. The last of
// them stands at the first of its places, and from `moves_at` on at the second.
struct World {
  std::vector<Eigen::Vector2d> places = {{5.0, 0.0}, {0.0, 5.0}, {-5.0, 0.0}, {0.0, -5.0}};
  Eigen::Vector2d second = {1.5, -5.5};
  int frames = 200;
  int moves_at = 100;
  std::vector<IncrementalFrame> log;
  std::vector<Se2> truth;
  std::vector<int> truth_modes;  // Of the observations: 0, or 1 for the second place.
};

World MakeWorld(int moves_at, std::uint64_t seed) {
  World world;
  world.moves_at = moves_at;
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  Se2 pose(0.0, -2.0, 0.0);
  for (int i = 0; i < world.frames; ++i) {
    IncrementalFrame frame;
    frame.stamp = StampFromSeconds(1000.0 + 0.5 * i);
    if (i > 0) {
      frame.motion.T_begin_end = Se2::Exp({0.2, 0.0, 0.1});
      frame.motion.cov = Eigen::Vector3d(1e-4, 1e-4, 1e-5).asDiagonal();
      pose = pose * frame.motion.T_begin_end *
             Se2::Exp({0.01 * normal(random), 0.01 * normal(random), 0.003 * normal(random)});
    }
    world.truth.push_back(pose);
    for (int group = 0; group < 4; ++group) {
      const bool moved = group == 3 && i >= moves_at;
      const Eigen::Vector2d q =
          pose.Inverse() * (moved ? world.second : world.places[static_cast<std::size_t>(group)]);
      const double bearing_rad = std::atan2(q.y(), q.x());
      if (std::abs(bearing_rad) > 0.7 || normal(random) < -0.5) continue;
      Observation seen;
      seen.z = {q.norm() + kRangeSd * normal(random), bearing_rad + kBearingSd * normal(random)};
      frame.observations.push_back({group, seen});
      world.truth_modes.push_back(moved ? 1 : 0);
    }
    world.log.push_back(std::move(frame));
  }
  return world;
}

IncrementalPrior Survey(const World& world) {
  IncrementalPrior prior;
  prior.groups = static_cast<int>(world.places.size());
  prior.mean.resize(2 * prior.groups);
  for (int g = 0; g < prior.groups; ++g) {
    prior.group.push_back(g);
    prior.mean.segment<2>(2 * g) = world.places[static_cast<std::size_t>(g)];
  }
  prior.cov = Eigen::MatrixXd::Identity(8, 8) * (kSurveySd * kSurveySd);
  return prior;
}

IncrementalOptions Options() {
  IncrementalOptions options;
  options.sensor.sd_range_m = kRangeSd;
  options.sensor.sd_bearing_rad = kBearingSd;
  options.sensor.max_bearing_rad = 0.7;
  options.sensor.detection_probability = 0.69;
  return options;
}

PoseWithCovariance Start(const World& world) {
  return {world.truth.front(), Eigen::Vector3d(0.01, 0.01, 1e-3).asDiagonal()};
}

IncrementalMapper MakeMapper(const World& world, const IncrementalOptions& options) {
  StatusOr<IncrementalMapper> mapper =
      IncrementalMapper::Create(options, Survey(world), Start(world));
  EXPECT_THAT(mapper, IsOk());
  return *std::move(mapper);
}

struct Totals {
  int created = 0;
  int merged = 0;
  int full = 0;
};

Totals DriveThrough(const World& world, IncrementalMapper* mapper) {
  Totals totals;
  for (const IncrementalFrame& frame : world.log) {
    const StatusOr<IncrementalStep> step = mapper->AddFrame(frame);
    EXPECT_THAT(step, IsOk());
    totals.created += step->modes_created;
    totals.merged += step->modes_merged;
    totals.full += step->fully_optimized ? 1 : 0;
  }
  return totals;
}

TEST(IncrementalMapperTest, FollowsALandmarkThatMoves) {
  const World world = MakeWorld(100, 1);
  IncrementalMapper mapper = MakeMapper(world, Options());
  DriveThrough(world, &mapper);
  for (int group = 0; group < 3; ++group) EXPECT_EQ(mapper.Modes(group).size(), 1u) << group;
  const std::vector<Eigen::Vector2d> modes = mapper.Modes(3);
  ASSERT_EQ(modes.size(), 2u);
  EXPECT_LT((modes[0] - world.places[3]).norm(), 0.1);
  EXPECT_LT((modes[1] - world.second).norm(), 0.1);
  EXPECT_THAT(mapper.T_map_vehicle(), IsNearPose(world.truth.back(), 0.1));
  EXPECT_EQ(mapper.Trajectory().size(), world.log.size());
}

TEST(IncrementalMapperTest, ChoicesAreThoseThatHeld) {
  const World world = MakeWorld(100, 2);
  IncrementalMapper mapper = MakeMapper(world, Options());
  DriveThrough(world, &mapper);
  ASSERT_THAT(mapper.Finish(), IsOk());
  const std::vector<int> choices = mapper.Choices();
  ASSERT_EQ(choices.size(), world.truth_modes.size());
  int wrong = 0;
  for (std::size_t i = 0; i < choices.size(); ++i) wrong += choices[i] != world.truth_modes[i];
  EXPECT_LE(wrong, 2);
}

// The graph of what the mapper ended up with, its values disturbed.
Graph BatchOf(const World& world, const IncrementalMapper& mapper) {
  Graph graph;
  graph.loss_scale = testing::kNoLoss;
  GraphRun run;
  run.correction_prior_sd.setConstant(1e-9);
  run.sensor_bias_sd.setConstant(1e-9);
  for (std::size_t f = 0; f < mapper.window().frames.size(); ++f) {
    const WindowFrame& frame = mapper.window().frames[f];
    run.poses.push_back(frame.T_map_vehicle * Se2(0.02, -0.01, 0.01));
    if (f > 0) run.motions.push_back(world.log[f].motion);
    for (const WindowObservation& seen : frame.observations) {
      if (seen.mode == kNoMode) continue;
      graph.observations.push_back(seen.factor);
      graph.observations.back().frame = FrameIndex(f);
      graph.observations.back().mode = ModeIndex(seen.mode);
    }
  }
  graph.runs.push_back(std::move(run));
  for (const WindowMode& mode : mapper.window().modes) graph.modes.push_back(mode.p_map_landmark);
  const IncrementalPrior survey = Survey(world);
  graph.priors = {
      {{0, 1, 2, 3}, survey.mean, Eigen::MatrixXd(Eigen::MatrixXd::Identity(8, 8) / kSurveySd)}};
  for (int i = 0; i < 20; ++i) SolveGraph({10}, &graph);
  return graph;
}

TEST(IncrementalMapperTest, OverTheWholeHistoryItIsTheBatchOfItsChoices) {
  const World world = MakeWorld(100, 11);
  // The batch has no start pose.
  const PoseWithCovariance anywhere{world.truth.front(), Eigen::Matrix3d::Identity() * 1e6};
  IncrementalOptions options = Options();
  options.smoother.loss_scale = testing::kNoLoss;
  StatusOr<IncrementalMapper> mapper = IncrementalMapper::Create(options, Survey(world), anywhere);
  ASSERT_THAT(mapper, IsOk());
  DriveThrough(world, &*mapper);
  ASSERT_THAT(mapper->Finish(), IsOk());
  ASSERT_EQ(mapper->Modes(3).size(), 2u);
  const Graph batch = BatchOf(world, *mapper);
  for (std::size_t f = 0; f < world.log.size(); ++f) {
    ASSERT_THAT(mapper->window().frames[f].T_map_vehicle,
                IsNearPose(batch.runs[0].poses[FrameIndex(f)], 1e-6));
  }
  for (std::size_t m = 0; m < batch.modes.size(); ++m) {
    if (mapper->window().modes[m].merged) continue;
    const Eigen::Vector2d& expected = batch.modes[ModeIndex(m)];
    EXPECT_LT((mapper->window().modes[m].p_map_landmark - expected).norm(), 1e-6) << m;
  }
}

TEST(IncrementalMapperTest, WhatStandsStillMakesNoMode) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const World world = MakeWorld(1000, seed);
    IncrementalMapper mapper = MakeMapper(world, Options());
    DriveThrough(world, &mapper);
    for (int group = 0; group < 4; ++group) {
      EXPECT_EQ(mapper.Modes(group).size(), 1u) << "seed " << seed << " group " << group;
    }
  }
}

TEST(IncrementalMapperTest, OneMisreadSightingMakesAModeOnlyAsPrinted) {
  World world = MakeWorld(1000, 3);
  Observation misread;
  misread.z = {2.0, 0.3};
  IncrementalFrame& frame = world.log[60];
  frame.observations = {{1, misread}};
  IncrementalMapper mapper = MakeMapper(world, Options());
  EXPECT_EQ(DriveThrough(world, &mapper).created, 0);
  IncrementalOptions printed = Options();
  printed.min_sightings = 1;
  printed.merge_probability = 0.0;
  printed.gate_probability = 1.0 - 1e-9;
  IncrementalMapper at_once = MakeMapper(world, printed);
  EXPECT_EQ(DriveThrough(world, &at_once).created, 1);
  EXPECT_EQ(at_once.Modes(1).size(), 2u);
}

TEST(IncrementalMapperTest, AWindowIsNearTheWholeHistory) {
  const World world = MakeWorld(100, 4);
  IncrementalMapper whole = MakeMapper(world, Options());
  DriveThrough(world, &whole);
  IncrementalOptions options = Options();
  options.window_s = 15.0;
  IncrementalMapper windowed = MakeMapper(world, options);
  DriveThrough(world, &windowed);
  EXPECT_LE(windowed.window().frames.size(), 31u + 8u);
  EXPECT_EQ(windowed.Trajectory().size(), world.log.size());
  EXPECT_THAT(windowed.T_map_vehicle(), IsNearPose(whole.T_map_vehicle(), 0.02));
  const std::vector<Eigen::Vector2d> expected = whole.Modes(3);
  const std::vector<Eigen::Vector2d> modes = windowed.Modes(3);
  ASSERT_EQ(modes.size(), expected.size());
  for (std::size_t k = 0; k < modes.size(); ++k) EXPECT_LT((modes[k] - expected[k]).norm(), 0.03);
}

// Move the world, and the map moves along: but for what is linearized when, along the axes.
TEST(IncrementalMapperTest, DoesNotDependOnTheFrameOfTheMap) {
  const World world = MakeWorld(100, 5);
  const Se2 T_other_map(10.0, -4.0, 2.0);
  World other = world;
  for (Se2& pose : other.truth) pose = T_other_map * pose;
  for (Eigen::Vector2d& place : other.places) place = T_other_map * place;
  IncrementalOptions options = Options();
  options.window_s = 20.0;
  IncrementalMapper mapper = MakeMapper(world, options);
  IncrementalMapper moved = MakeMapper(other, options);
  DriveThrough(world, &mapper);
  DriveThrough(other, &moved);
  EXPECT_EQ(mapper.Choices(), moved.Choices());
  EXPECT_THAT(moved.T_map_vehicle(), IsNearPose(T_other_map * mapper.T_map_vehicle(), 1e-3));
}

TEST(IncrementalMapperTest, EverySelectorMapsTheWorld) {
  const World world = MakeWorld(100, 6);
  for (const SelectorKind kind : AllSelectors()) {
    SCOPED_TRACE(SelectorName(kind));
    IncrementalOptions options = Options();
    options.selector.kind = kind;
    options.window_s = 10.0;
    IncrementalMapper mapper = MakeMapper(world, options);
    DriveThrough(world, &mapper);
    ASSERT_THAT(mapper.Finish(), IsOk());
    const bool one_position = kind == SelectorKind::kNoHypotheses;
    EXPECT_EQ(mapper.Modes(3).size(), one_position ? 1u : 2u);
    if (one_position) continue;
    EXPECT_THAT(mapper.T_map_vehicle(), IsNearPose(world.truth.back(), 0.1));
  }
}

TEST(IncrementalMapperTest, MakesModesOfLandmarksThatTheMapDoesNotHave) {
  const World world = MakeWorld(1000, 7);
  IncrementalPrior prior = Survey(world);
  prior.group.pop_back();
  prior.mean = prior.mean.head<6>().eval();
  prior.cov = prior.cov.topLeftCorner<6, 6>().eval();
  StatusOr<IncrementalMapper> mapper = IncrementalMapper::Create(Options(), prior, Start(world));
  ASSERT_THAT(mapper, IsOk());
  DriveThrough(world, &*mapper);
  ASSERT_EQ(mapper->Modes(3).size(), 1u);
  EXPECT_LT((mapper->Modes(3)[0] - world.places[3]).norm(), 0.1);
}

TEST(IncrementalMapperTest, WithoutAMapTheStartHoldsTheFrame) {
  const World world = MakeWorld(1000, 12);
  IncrementalPrior prior;
  prior.groups = 4;
  IncrementalOptions options = Options();
  options.window_s = 20.0;
  StatusOr<IncrementalMapper> mapper = IncrementalMapper::Create(options, prior, Start(world));
  ASSERT_THAT(mapper, IsOk());
  DriveThrough(world, &*mapper);
  for (int group = 0; group < 4; ++group) {
    const std::vector<Eigen::Vector2d> modes = mapper->Modes(group);
    ASSERT_EQ(modes.size(), 1u) << group;
    EXPECT_LT((modes[0] - world.places[static_cast<std::size_t>(group)]).norm(), 0.15) << group;
  }
}

TEST(IncrementalMapperTest, SameInputSameBits) {
  const World world = MakeWorld(100, 8);
  IncrementalOptions options = Options();
  options.selector.kind = SelectorKind::kMcts;
  options.window_s = 10.0;
  IncrementalMapper a = MakeMapper(world, options);
  IncrementalMapper b = MakeMapper(world, options);
  DriveThrough(world, &a);
  DriveThrough(world, &b);
  EXPECT_THAT(a.T_map_vehicle(), IsNearPose(b.T_map_vehicle(), 0.0));
  EXPECT_EQ(a.Choices(), b.Choices());
}

TEST(IncrementalMapperTest, RejectsWhatDoesNotFit) {
  const World world = MakeWorld(100, 9);
  IncrementalOptions options;
  options.gate_probability = 1.0;
  EXPECT_THAT(IncrementalMapper::Create(options, Survey(world), Start(world)).status(),
              StatusIs(StatusCode::kInvalidArgument, "gate_probability: 1"));
  IncrementalPrior prior = Survey(world);
  prior.mean = prior.mean.head<4>().eval();
  EXPECT_THAT(IncrementalMapper::Create({}, prior, Start(world)).status(),
              StatusIs(StatusCode::kInvalidArgument, "mean 4"));
  prior = Survey(world);
  prior.cov(0, 0) = -1.0;
  EXPECT_THAT(IncrementalMapper::Create({}, prior, Start(world)).status(),
              StatusIs(StatusCode::kInvalidArgument, "not positive definite"));
  prior = Survey(world);
  prior.group[0] = 4;
  EXPECT_THAT(IncrementalMapper::Create({}, prior, Start(world)).status(),
              StatusIs(StatusCode::kInvalidArgument, "group 4"));
  prior = Survey(world);
  prior.choice_before = {0, 0, 0, 1};
  EXPECT_THAT(IncrementalMapper::Create({}, prior, Start(world)).status(),
              StatusIs(StatusCode::kInvalidArgument, "choice 1 of 1"));
}

TEST(IncrementalMapperTest, ValuesThatAreNotFiniteAreAnError) {
  World world = MakeWorld(100, 10);
  world.log[0].observations = {{0, Observation()}};
  world.log[0].observations[0].observation.z = {std::nan(""), 0.0};
  IncrementalMapper mapper = MakeMapper(world, Options());
  const StatusOr<IncrementalStep> step = mapper.AddFrame(world.log[0]);
  EXPECT_THAT(step.status(), StatusIs(StatusCode::kInvalidArgument, "frame 0"));
}

}  // namespace
}  // namespace shiftmap
