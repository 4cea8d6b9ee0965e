// SPDX-License-Identifier: Apache-2.0
//
// A standing vehicle sees eight landmarks for three seconds. Where they stand, and where the
// vehicle takes itself to be, differs by test.
#include "localizer/monitor/wrong_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

constexpr int kSeen = 8;
constexpr double kScanS = 0.25;

Stamp At(double seconds) { return StampFromSeconds(1000.0 + seconds); }

PoseWithCovariance SureOf(const Se2& T_map_vehicle) {
  return {T_map_vehicle, Eigen::Vector3d(0.01, 0.01, 0.0004).asDiagonal()};
}

// One mode each; the first eight landmarks are in view of the origin, the others behind it.
MapContent Map(std::uint64_t seed) {
  MapContent content = MakeTwoModeMap(2 * kSeen, 10.0, seed);
  std::mt19937_64 random(seed);
  std::uniform_real_distribution<double> range(2.0, 6.0);
  std::uniform_real_distribution<double> bearing(-0.6, 0.6);
  std::vector<Eigen::Matrix2d> marginals;
  for (std::size_t i = 0; i < content.groups.size(); ++i) {
    LandmarkGroup& group = content.groups[i];
    group.modes.resize(1);
    group.chain = ModeChain::Uniform(1, 1e-6);
    group.probabilities = Eigen::Vector2d(0.05, 0.95);
    const double r = range(random);
    const double b = bearing(random) + (i < kSeen ? 0.0 : M_PI);
    group.modes[0].p_map_landmark = {r * std::cos(b), r * std::sin(b)};
    marginals.push_back(group.modes[0].cov_p_map_landmark);
  }
  content.covariance = JointCovariance(marginals, {});
  return content;
}

// What the monitors hold after three seconds of landmarks that stand at `truth` in the vehicle
// frame.
struct Seen {
  Seen(const MapContent& content,
       const std::vector<Eigen::Vector2d>& truth,
       int agreeing,
       bool turned)
      : health(content.groups.size()) {
    // Before, the pose was right.
    for (int group = 0; turned && group < kSeen; ++group) health.Add(At(-1.0), group, true, 2.0);
    for (double t = 0.0; t <= 3.0; t += kScanS) {
      WindowScan step;
      step.scan.stamp = At(t);
      step.motion.elapsed_s = kScanS;
      for (int group = 0; group < kSeen; ++group) {
        const auto i = static_cast<std::size_t>(group);
        Observation observation;
        observation.signature = content.groups[i].signature;
        observation.z = {truth[i].norm(), std::atan2(truth[i].y(), truth[i].x())};
        step.scan.observations.push_back(observation);
        const bool agrees = group < agreeing;
        health.Add(At(t), group, agrees, agrees ? std::optional(2.0) : std::nullopt);
      }
      recent.Add(step);
    }
  }

  std::optional<OtherPose> Other(const MapContent& content, const Se2& pose) const {
    const FieldOfView sector(content.calibration.sensor, {});
    return FindWrongPose({SureOf(pose), At(3.0), recent, health}, Snapshot(content), sector, {});
  }

  HealthMonitor health;
  RecentScans recent;
};

std::vector<Eigen::Vector2d> InPlace(const MapContent& content) {
  return PositionsOf(content, std::vector<int>(content.groups.size(), 1));
}

TEST(WrongPose, OneMotionThatPutsAllBackIsFound) {
  const MapContent content = Map(1);
  const Seen seen(content, InPlace(content), 0, true);
  const auto other = seen.Other(content, Se2(1.5, -1.0, 0.3));
  ASSERT_TRUE(other);
  EXPECT_TRUE(other->certain);
  EXPECT_TRUE(seen.Other(content, Se2(0.0, 0.0, 0.5)));
}

TEST(WrongPose, ThePoseThatExplainsAllIsNotWrong) {
  const MapContent content = Map(1);
  const Seen seen(content, InPlace(content), 0, true);
  EXPECT_FALSE(seen.Other(content, Se2(0.05, -0.05, 0.01)));
}

TEST(WrongPose, AsLongAsOthersAgreeThePoseMayBeRight) {
  const MapContent content = Map(1);
  const Seen seen(content, InPlace(content), 4, true);
  EXPECT_FALSE(seen.Other(content, Se2(1.5, -1.0, 0.3)));
}

// All eight at once, and none that agrees: by chance some motion fits three of them.
TEST(WrongPose, LandmarksThatMovedEachByItselfAreNotExplainedByOne) {
  constexpr int kWorlds = 200;
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> offset(-2.0, 2.0);
  int wrong = 0;
  for (int world = 0; world < kWorlds; ++world) {
    const MapContent content = Map(static_cast<std::uint64_t>(world) + 1);
    std::vector<Eigen::Vector2d> truth = InPlace(content);
    for (Eigen::Vector2d& p : truth) {
      Eigen::Vector2d moved = Eigen::Vector2d::Zero();
      while (moved.norm() < 1.2) moved = {offset(random), offset(random)};
      p += moved;
    }
    const Seen seen(content, truth, 0, true);
    wrong += seen.Other(content, Se2()).has_value();
  }
  EXPECT_LE(wrong, kWorlds / 10);
}

TEST(WrongPose, WhatIsMissedTellsARackThatMovedFromAVehicleThatWasCarried) {
  const MapContent content = Map(1);
  const Se2 rack(1.5, -1.0, 0.2);
  std::vector<Eigen::Vector2d> truth = InPlace(content);
  for (Eigen::Vector2d& p : truth) p = rack * p;
  const Seen moved(content, truth, 0, false);
  EXPECT_FALSE(moved.Other(content, Se2()));

  // Carried from where it looked at the others, which are missed now.
  const Seen carried(content, InPlace(content), 0, false);
  const auto other = carried.Other(content, Se2(0.0, 0.0, M_PI));
  ASSERT_TRUE(other);
  EXPECT_FALSE(other->certain);
}

}  // namespace
}  // namespace shiftmap
