// SPDX-License-Identifier: Apache-2.0
#include "localizer/initialization/global_start.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <cmath>
#include <random>
#include <string>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

std::vector<WindowScan> WindowOf(const MapContent& content, const SimulatedRun& simulated) {
  OdometryBuffer odometry(content.calibration.odometry);
  for (const OdometrySample& sample : simulated.run.odometry) odometry.Add(sample);
  std::vector<WindowScan> window;
  for (const Scan& scan : simulated.run.scans) {
    window.push_back({scan, odometry.Take(scan.stamp)});
  }
  return window;
}

// How far a start is off where the vehicle was at its scan.
Eigen::Vector3d ErrorOf(const GlobalStart& start, const SimulatedRun& simulated) {
  return (start.pose.T_map_vehicle.Inverse() * simulated.T_map_vehicle[start.scan]).Log();
}

// A shift through a site of twelve landmarks, each at its first mode with probability 0.85.
struct ChangedSite {
  MapContent content;
  SimulatedRun simulated;
};

// @param moves  Of landmarks drawn with repetition, by a metre or two, before the shift.
ChangedSite DrawChangedSite(std::uint64_t seed, int moves) {
  constexpr int kLandmarks = 12;
  std::mt19937_64 random(seed);
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  ChangedSite site;
  site.content = MakeTwoModeMap(kLandmarks, 15.0, seed);
  for (LandmarkGroup& group : site.content.groups) {
    group.probabilities = Eigen::Vector3d(0.1, 0.85, 0.05);
  }
  std::vector<Eigen::Vector2d> truth = PositionsOf(site.content, std::vector<int>(kLandmarks, 1));
  for (int move = 0; move < moves; ++move) {
    const double length = uniform(0.7, 2.5);
    const double direction = uniform(-M_PI, M_PI);
    truth[static_cast<std::size_t>(uniform(0.0, kLandmarks))] +=
        length * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  }
  SimulationOptions options;
  options.seed = seed;
  options.duration_s = uniform(2.0, 12.0);
  options.T_map_start = Se2(uniform(-4.0, 4.0), uniform(-4.0, 4.0), uniform(-3.0, 3.0));
  site.simulated = Simulate(site.content, truth, options);
  return site;
}

TEST(GlobalStart, FindsThePoseWhateverModesHold) {
  const MapContent content = MakeTwoModeMap(15, 14.0, 33);
  const MapSnapshot snapshot = Snapshot(content);
  std::vector<int> states(content.groups.size(), 2);
  for (std::size_t i = 0; i < states.size(); i += 5) states[i] = 1;
  int found = 0;
  double nees = 0.0;
  constexpr int kRuns = 40;
  for (int i = 0; i < kRuns; ++i) {
    SimulationOptions options;
    options.seed = 500 + static_cast<std::uint64_t>(i);
    options.duration_s = 12.0;
    options.clutter_share = 0.05;
    options.T_map_start = Se2(0.1 * i - 2.0, 1.0 - 0.05 * i, 0.7 * i);
    const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
    const auto start = FindGlobalStart(WindowOf(content, simulated), snapshot, {});
    if (!start) continue;
    ++found;
    const Eigen::Vector3d error = ErrorOf(*start, simulated);
    const double squared = error.dot(start->pose.cov_T_map_vehicle.inverse() * error);
    EXPECT_LT(squared, ChiSquareQuantile(0.9999, 3)) << i;
    EXPECT_LT(error.head<2>().norm(), 1.5) << i;
    nees += squared;
  }
  EXPECT_GT(found, kRuns / 2);
  EXPECT_LT(nees / found, 4.0);  // The covariance is honest: 3 expected, or less.
}

// Most landmarks stand at another mode than the map's favourite, one detection in twenty has a
// wrong signature, and the vehicle drives.
TEST(GlobalStart, IsNeverWrongInAThousandWorlds) {
  constexpr int kWorlds = 1000;
  int right = 0;
  int wrong = 0;
  std::string wrong_seeds;
  for (int i = 0; i < kWorlds; ++i) {
    const auto seed = static_cast<std::uint64_t>(7000 + i);
    std::mt19937_64 random(seed);
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    const int groups = 6 + static_cast<int>(uniform(0.0, 30.0));
    const MapContent content = MakeTwoModeMap(groups, 2.5 * std::sqrt(groups) + 3.0, seed);
    std::vector<int> states;
    for (int group = 0; group < groups; ++group) states.push_back(uniform(0.0, 1.0) < 0.8 ? 2 : 1);
    SimulationOptions options;
    options.seed = seed;
    options.duration_s = uniform(1.0, 12.0);
    options.v_mps = uniform(0.0, 1.0);
    options.omega_radps = uniform(-0.5, 0.5);
    options.clutter_share = 0.05;
    options.T_map_start = Se2(uniform(-2.0, 2.0), uniform(-2.0, 2.0), uniform(-3.0, 3.0));
    const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
    const auto start = FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {});
    if (!start) continue;
    const Eigen::Vector3d error = ErrorOf(*start, simulated);
    if (error.head<2>().norm() < 1.5 && std::abs(error.z()) < 0.5) {
      ++right;
      continue;
    }
    ++wrong;
    wrong_seeds +=
        fmt::format(" {} ({} explained, {})", seed, start->explained, start->probability);
  }
  RecordProperty("right", right);
  RecordProperty("refused", kWorlds - right - wrong);
  EXPECT_EQ(wrong, 0) << wrong_seeds;
  EXPECT_GT(right, kWorlds / 2);
}

// Most landmarks of a small, crowded site went where no mode is, and every landmark has two places
// that it does not stand at: poses by chance explain three of them often.
TEST(GlobalStart, IsNotWrongWhereMostLandmarksStandElsewhere) {
  constexpr int kWorlds = 400;
  int right = 0;
  int wrong = 0;
  for (int i = 0; i < kWorlds; ++i) {
    const auto seed = static_cast<std::uint64_t>(9000 + i);
    std::mt19937_64 random(seed);
    const auto uniform = [&](double low, double high) {
      return std::uniform_real_distribution<double>(low, high)(random);
    };
    const MapContent content = MakeTwoModeMap(10, 11.0, seed);
    std::vector<Eigen::Vector2d> truth = PositionsOf(content, std::vector<int>(10, 1));
    for (std::size_t group = 4 + seed % 3; group < truth.size(); ++group) {
      truth[group] = {uniform(-5.5, 5.5), uniform(-5.5, 5.5)};
    }
    SimulationOptions options;
    options.seed = seed;
    options.duration_s = uniform(5.0, 30.0);
    options.T_map_start = Se2(uniform(-2.0, 2.0), uniform(-2.0, 2.0), uniform(-3.0, 3.0));
    const SimulatedRun simulated = Simulate(content, truth, options);
    const auto start = FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {});
    if (!start) continue;
    const Eigen::Vector3d error = ErrorOf(*start, simulated);
    ++(error.head<2>().norm() < 1.0 && std::abs(error.z()) < 0.3 ? right : wrong);
  }
  RecordProperty("right", right);
  RecordProperty("wrong", wrong);
  EXPECT_LE(wrong, kWorlds / 200);
  EXPECT_GT(right, kWorlds / 20);
}

// Landmarks have just moved by a metre or two, which the map does not know. A pose that takes one
// of them for unmoved fits it and the others halfway, and may be about as probable as the right
// one.
TEST(GlobalStart, StatesWhatALandmarkThatMovedALittleLeavesOpen) {
  constexpr int kWorlds = 3000;
  int found = 0;
  int beyond = 0;
  double nees = 0.0;
  for (int i = 0; i < kWorlds; ++i) {
    const auto [content, simulated] = DrawChangedSite(static_cast<std::uint64_t>(11000 + i), 8);
    const auto start = FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {});
    if (!start) continue;
    ++found;
    const Eigen::Vector3d error = ErrorOf(*start, simulated);
    const double squared = error.dot(start->pose.cov_T_map_vehicle.inverse() * error);
    beyond += squared > ChiSquareQuantile(0.999, 3);
    nees += squared;
  }
  RecordProperty("found", found);
  RecordProperty("beyond", beyond);
  EXPECT_GT(found, kWorlds / 10);
  EXPECT_LE(beyond, found / 100);
  EXPECT_LT(nees / found, 4.0);
}

// Landmarks come into view only after a long drive, whose begin dead reckoning does not know.
TEST(GlobalStart, GoesBackNoFurtherThanDeadReckoningIsGoodFor) {
  const MapContent content = MakeTwoModeMap(15, 14.0, 33);
  const std::vector<int> states(content.groups.size(), 1);
  constexpr double kBlindS = 40.0;
  int found = 0;
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    SimulationOptions options;
    options.seed = seed;
    options.duration_s = kBlindS + 8.0;
    SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
    const Stamp begin = simulated.run.scans.front().stamp;
    for (Scan& scan : simulated.run.scans) {
      if (scan.stamp < begin + FromSeconds(kBlindS)) scan.observations.clear();
    }
    const auto start = FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {});
    if (!start) continue;
    ++found;
    const Stamp stamp = simulated.run.scans[start->scan].stamp;
    EXPECT_GT(stamp, begin + FromSeconds(kBlindS - 5.0)) << seed;
    EXPECT_LT(std::sqrt(start->pose.cov_T_map_vehicle(0, 0)), 0.4) << seed;
    EXPECT_LT(std::sqrt(start->pose.cov_T_map_vehicle(2, 2)), 0.2) << seed;
    const Eigen::Vector3d error = ErrorOf(*start, simulated);
    EXPECT_LT(error.dot(start->pose.cov_T_map_vehicle.inverse() * error),
              ChiSquareQuantile(0.9999, 3))
        << seed;
  }
  EXPECT_GT(found, 10);
}

// The pose of a newer part of the window has to outweigh what the older part says against it.
TEST(GlobalStart, SightingsThatContradictAPoseAreNotLeftOut) {
  constexpr int kWorlds = 6000;
  int recent_wrong = 0;
  int part_wrong = 0;
  int recent_right = 0;
  for (int i = 0; i < kWorlds; ++i) {
    const ChangedSite site = DrawChangedSite(static_cast<std::uint64_t>(21000 + i), 2);
    const std::vector<WindowScan> window = WindowOf(site.content, site.simulated);
    const MapSnapshot snapshot = Snapshot(site.content);
    const auto is_wrong = [&](const GlobalStart& start) {
      return ErrorOf(start, site.simulated).head<2>().norm() > 1.0;
    };
    if (const auto recent = FindRecentStart(window, snapshot, {})) {
      ++(is_wrong(*recent) ? recent_wrong : recent_right);
    }
    for (std::size_t length = window.size(); length > 0; length /= 2) {
      const std::size_t first = window.size() - length;
      auto part = FindGlobalStart(std::span(window).subspan(first), snapshot, {});
      if (!part) continue;
      part->scan += first;
      part_wrong += is_wrong(*part);
      break;
    }
  }
  RecordProperty("right", recent_right);
  RecordProperty("wrong", recent_wrong);
  RecordProperty("part_wrong", part_wrong);
  EXPECT_GT(recent_right, kWorlds / 3);
  EXPECT_LT(3 * recent_wrong, 2 * part_wrong);
}

// A wheel slips halfway: no pose explains the whole window, and the newer half decides.
TEST(GlobalStart, AfterASlipTheNewerPartDecides) {
  const MapContent content = MakeTwoModeMap(40, 16.0, 33);
  const MapSnapshot snapshot = Snapshot(content);
  int whole = 0;
  int right = 0;
  constexpr int kRuns = 30;
  for (int i = 0; i < kRuns; ++i) {
    SimulationOptions options;
    options.seed = 900 + static_cast<std::uint64_t>(i);
    options.duration_s = 16.0;
    options.T_map_start = Se2(0.1 * i - 2.0, 1.0 - 0.05 * i, 0.7 * i);
    const SimulatedRun simulated = Simulate(
        content, PositionsOf(content, std::vector<int>(content.groups.size(), 1)), options);
    std::vector<WindowScan> window = WindowOf(content, simulated);
    MotionIncrement& slip = window[window.size() / 2].motion.increment;
    slip.T_begin_end = slip.T_begin_end * Se2(1.5, 0.5, 0.6);
    whole += FindGlobalStart(window, snapshot, {}).has_value();
    const auto recent = FindRecentStart(window, snapshot, {});
    if (!recent) continue;
    const Eigen::Vector3d error = ErrorOf(*recent, simulated);
    EXPECT_LT(error.dot(recent->pose.cov_T_map_vehicle.inverse() * error),
              ChiSquareQuantile(0.9999, 3))
        << i;
    ++right;
  }
  EXPECT_GE(right, whole);
  EXPECT_GT(right, kRuns / 2);
}

// A map may have been loaded long before the shift: modes hold as probable as they are by then.
TEST(GlobalStart, WeighsModesAsOfTheWindow) {
  MapContent old = MakeTwoModeMap(15, 14.0, 33);
  SimulationOptions options;
  options.duration_s = 12.0;
  const SimulatedRun simulated =
      Simulate(old, PositionsOf(old, std::vector<int>(old.groups.size(), 1)), options);
  const std::vector<WindowScan> window = WindowOf(old, simulated);
  const Stamp end = window.back().scan.stamp;
  old.stamp = end - FromSeconds(30.0 * 86400.0);
  MapContent present = old;
  present.stamp = end;
  for (LandmarkGroup& group : present.groups) {
    group.probabilities = group.chain.Propagate(group.probabilities, end - old.stamp);
  }
  const auto start = FindGlobalStart(window, Snapshot(old), {});
  const auto expected = FindGlobalStart(window, Snapshot(present), {});
  ASSERT_TRUE(start && expected);
  EXPECT_EQ(start->probability, expected->probability);
  EXPECT_EQ(start->pose.cov_T_map_vehicle, expected->pose.cov_T_map_vehicle);
}

TEST(GlobalStart, DoesNotGuess) {
  const MapContent content = MakeTwoModeMap(15, 14.0, 33);
  const MapSnapshot snapshot = Snapshot(content);
  std::vector<WindowScan> window(1);
  for (const int group : {0, 1}) {
    Observation observation;
    observation.signature = content.groups[static_cast<std::size_t>(group)].signature;
    observation.z = {3.0, 0.3 * group};
    window[0].scan.observations.push_back(observation);
  }
  EXPECT_FALSE(FindGlobalStart(window, snapshot, {}));
}

TEST(GlobalStart, KeepsCollectingWhenTwoPlacesLookAlike) {
  // Every landmark's second mode is its first one, 20 m further: the vehicle may be in either copy.
  MapContent content = MakeTwoModeMap(6, 10.0, 3);
  for (LandmarkGroup& group : content.groups) {
    group.modes[1].p_map_landmark = group.modes[0].p_map_landmark + Eigen::Vector2d(20.0, 0.0);
  }
  content.calibration.sensor.max_bearing_rad = 3.1;
  SimulationOptions options;
  options.duration_s = 10.0;
  const std::vector<int> states(content.groups.size(), 1);
  const SimulatedRun simulated = Simulate(content, PositionsOf(content, states), options);
  EXPECT_FALSE(FindGlobalStart(WindowOf(content, simulated), Snapshot(content), {}));
}

}  // namespace
}  // namespace shiftmap
