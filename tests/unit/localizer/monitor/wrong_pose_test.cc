// SPDX-License-Identifier: Apache-2.0
//
// A vehicle sees up to eight landmarks for three seconds. Where they stand, where the vehicle takes
// itself to be, and how it moves, differs by test.
#include "localizer/monitor/wrong_pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "localizer/initialization/start_pose.h"
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

// How the vehicle moves from scan to scan, and what odometry makes of it.
struct Motion {
  Se2 step;
  Se2 by_odometry;
};

// What the monitors hold after three seconds of landmarks that stand at `truth` in the frame of the
// vehicle at the begin.
struct Seen {
  Seen(const MapContent& content,
       const std::vector<Eigen::Vector2d>& truth,
       int agreeing,
       bool turned,
       int in_view = kSeen,
       const Motion& motion = {})
      : health(content.groups.size()) {
    Se2 T_begin_vehicle;
    // Before, the pose was right.
    for (int group = 0; turned && group < kSeen; ++group) health.Add(At(-1.0), group, true, 2.0);
    for (double t = 0.0; t <= 3.0; t += kScanS) {
      WindowScan step;
      step.scan.stamp = At(t);
      step.motion.elapsed_s = kScanS;
      step.motion.increment.T_begin_end = motion.by_odometry;
      for (int group = 0; group < in_view; ++group) {
        const Eigen::Vector2d q =
            T_begin_vehicle.Inverse() * truth[static_cast<std::size_t>(group)];
        Observation observation;
        observation.signature = content.groups[static_cast<std::size_t>(group)].signature;
        observation.z = {q.norm(), std::atan2(q.y(), q.x())};
        step.scan.observations.push_back(observation);
        const bool agrees = group < agreeing;
        health.Add(At(t), group, agrees, agrees ? std::optional(2.0) : std::nullopt);
      }
      recent.Add(step);
      T_begin_vehicle = T_begin_vehicle * motion.step;
    }
  }

  std::optional<PoseFault> Fault(const MapContent& content, const Se2& pose) const {
    const FieldOfView sector(content.calibration.sensor, false);
    return FindWrongPose({SureOf(pose), At(3.0), recent, health}, Snapshot(content), sector, {});
  }

  // As if the pose had been started when the first scan came.
  std::optional<PoseWithCovariance> OtherStart(const MapContent& content, const Se2& pose) const {
    return FindOtherStart({SureOf(pose), At(3.0), recent, health}, At(0.0), Snapshot(content), {});
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
  const auto fault = seen.Fault(content, Se2(1.5, -1.0, 0.3));
  ASSERT_TRUE(fault);
  EXPECT_FALSE(fault->rival);
  EXPECT_FALSE(fault->odometry);
  EXPECT_TRUE(seen.Fault(content, Se2(0.0, 0.0, 0.5)));
}

TEST(WrongPose, ThePoseThatExplainsAllIsNotWrong) {
  const MapContent content = Map(1);
  const Seen seen(content, InPlace(content), 0, true);
  EXPECT_FALSE(seen.Fault(content, Se2(0.05, -0.05, 0.01)));
}

TEST(WrongPose, AsLongAsOthersAgreeThePoseMayBeRight) {
  const MapContent content = Map(1);
  const Seen seen(content, InPlace(content), 4, true);
  EXPECT_FALSE(seen.Fault(content, Se2(1.5, -1.0, 0.3)));
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
    wrong += seen.Fault(content, Se2()).has_value();
  }
  EXPECT_LE(wrong, kWorlds / 10);
}

TEST(WrongPose, WhatIsMissedTellsARackThatMovedFromAVehicleThatWasCarried) {
  const MapContent content = Map(1);
  const Se2 rack(1.5, -1.0, 0.2);
  std::vector<Eigen::Vector2d> truth = InPlace(content);
  for (Eigen::Vector2d& p : truth) p = rack * p;
  const Seen moved(content, truth, 0, false);
  EXPECT_FALSE(moved.Fault(content, Se2()));

  // Carried from where it looked at the others, which are missed now.
  const Seen carried(content, InPlace(content), 0, false);
  const auto fault = carried.Fault(content, Se2(0.0, 0.0, M_PI));
  ASSERT_TRUE(fault);
  EXPECT_TRUE(fault->rival);
}

// Landmarks at places that no pose explains turn about the vehicle: it turns, or all of them drive.
TEST(WrongPose, OdometryIsWrongWhereNoLandmarkStandsByIt) {
  const MapContent content = Map(1);
  std::vector<Eigen::Vector2d> moved = InPlace(content);
  std::mt19937_64 random(7);
  std::uniform_real_distribution<double> offset(-2.0, 2.0);
  for (Eigen::Vector2d& p : moved) p += Eigen::Vector2d(offset(random), offset(random));
  const Se2 turn(0.0, 0.0, 0.5 * kScanS);
  for (const int in_view : {1, 2, 3}) {
    const auto fault = Seen(content, moved, 0, false, in_view, {turn, Se2()}).Fault(content, Se2());
    EXPECT_TRUE(fault && fault->odometry) << in_view;
    EXPECT_FALSE(Seen(content, moved, 0, false, in_view, {turn, turn}).Fault(content, Se2()));
    EXPECT_FALSE(Seen(content, moved, 0, false, in_view, {}).Fault(content, Se2()));
  }
  // One of two may be carried.
  Seen carried(content, moved, 0, false, 1, {turn, Se2()});
  carried.health.Add(At(3.0), 1, true, 2.0);
  EXPECT_FALSE(carried.Fault(content, Se2()));
}

// The vehicle starts beside a rack that moved. The rack's landmarks agree on a wrong pose, the
// other landmarks agree on the origin. Another pose questions the start if it explains more
// landmarks.
TEST(WrongPose, AStartIsQuestionedByAPoseThatExplainsMore) {
  constexpr int kWorlds = 20;
  const Se2 rack(1.5, -1.0, 0.2);
  int questioned = 0;
  for (std::uint64_t world = 1; world <= kWorlds; ++world) {
    const MapContent content = Map(world);
    for (int in_rack = 3; in_rack <= 5; ++in_rack) {
      const auto start = [&](int first_in_rack, int agreeing, const Se2& pose) {
        std::vector<Eigen::Vector2d> truth = InPlace(content);
        for (int group = first_in_rack; group < first_in_rack + in_rack; ++group) {
          Eigen::Vector2d& p = truth[static_cast<std::size_t>(group)];
          p = rack * p;
        }
        return Seen(content, truth, agreeing, false).OtherStart(content, pose);
      };
      // Landmarks that agree come first.
      const auto of_others = start(0, in_rack, rack.Inverse());
      const auto of_rack = start(kSeen - in_rack, kSeen - in_rack, Se2());
      questioned += of_others.has_value() + of_rack.has_value();
      if (of_others) {
        EXPECT_LT(in_rack, kSeen - in_rack);
        EXPECT_FALSE(ClearlyApart(*of_others, SureOf(Se2())));
      }
      if (of_rack) {
        EXPECT_GT(in_rack, kSeen - in_rack);
        EXPECT_FALSE(ClearlyApart(*of_rack, SureOf(rack.Inverse())));
      }
    }
  }
  EXPECT_GE(questioned, 2 * kWorlds * 8 / 10);
}

}  // namespace
}  // namespace shiftmap
