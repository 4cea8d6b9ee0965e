// SPDX-License-Identifier: Apache-2.0
//
// What a vehicle tells its fleet about its pose holds over simulated shifts: the score is as
// uniform as a p-value while the pose is right and low while it is wrong, and the range holds the
// position as often as it says.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "localizer/live/shift.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap::live {
namespace {

constexpr int kShifts = 150;
constexpr double kShiftS = 40.0;
constexpr double kEveryS = 8.0;
constexpr double kProbability = 0.95;

struct Told {
  double score = 0.0;
  double error_m = 0.0;
  double range_m = 0.0;
  LocalizerState state = LocalizerState::kInitializing;
  double time_s = 0.0;
};

// A map whose landmarks stand where its covariance lets them.
std::vector<Eigen::Vector2d> TrueWorld(const MapContent& content, std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector2d> truth =
      PositionsOf(content, std::vector<int>(content.groups.size(), 1));
  for (Eigen::Vector2d& p : truth) p += 0.05 * Eigen::Vector2d(normal(random), normal(random));
  return truth;
}

ShiftHeader Header() {
  const LocalizerOptions options;
  ShiftHeader header;
  header.uuid = "uuid";
  header.vehicle = "cart";
  header.alpha = options.hypotheses.alpha;
  header.max_leaves = options.hypotheses.max_leaves;
  return header;
}

// What the shift said, every `every_s` from `from_s` on.
// @param carried_at_s  The vehicle is set elsewhere then.
std::vector<Told> Drive(std::uint64_t seed, double from_s, double every_s, double carried_at_s) {
  const MapContent content = MakeTwoModeMap(30, 20.0, seed);
  SimulationOptions simulation;
  simulation.seed = seed;
  simulation.duration_s = kShiftS;
  const std::vector<Eigen::Vector2d> world = TrueWorld(content, seed);
  SimulatedRun run = Simulate(content, world, simulation);
  if (carried_at_s > 0.0) {
    simulation.T_map_start = Se2(3.0, 3.0, 2.5);
    const SimulatedRun elsewhere = Simulate(content, world, simulation);
    for (std::size_t i = 0; i < run.run.scans.size(); ++i) {
      if (ToSeconds(run.run.scans[i].stamp - run.run.scans[0].stamp) < carried_at_s) continue;
      run.run.scans[i] = elsewhere.run.scans[i];
      run.T_map_vehicle[i] = elsewhere.T_map_vehicle[i];
    }
  }
  Shift shift(Snapshot(content), Header());
  std::vector<Event> events;
  std::vector<Told> told;
  std::size_t scan = 0;
  double next_s = from_s;
  for (const RunEvent& item : MergeEvents(run.run)) {
    events.clear();
    EXPECT_TRUE(shift.Process(item, &events).ok());
    if (!std::holds_alternative<Scan>(item)) continue;
    const Se2& truth = run.T_map_vehicle[scan++];
    const double now_s = ToSeconds(StampOf(item) - run.run.scans[0].stamp);
    if (now_s < next_s || !shift.Pose()) continue;
    next_s += every_s;
    told.push_back({shift.Score(),
                    (shift.Pose()->pose.T_map_vehicle.translation() - truth.translation()).norm(),
                    shift.RadiusHolding(kProbability),
                    shift.localizer().state(),
                    now_s});
  }
  return told;
}

std::vector<Told> DriveAll() {
  std::vector<Told> all;
  for (int i = 0; i < kShifts; ++i) {
    const std::vector<Told> told =
        Drive(static_cast<std::uint64_t>(100 + i), kEveryS, kEveryS, 0.0);
    all.insert(all.end(), told.begin(), told.end());
  }
  return all;
}

TEST(TrustTest, ScoreIsNearlyUniformAndRangeHoldsThePositionWhileThePoseIsRight) {
  std::vector<Told> told = DriveAll();
  ASSERT_GT(told.size(), 500u);
  const auto n = static_cast<double>(told.size());
  const auto inside =
      std::count_if(told.begin(), told.end(), [](const Told& t) { return t.error_m <= t.range_m; });
  std::sort(
      told.begin(), told.end(), [](const Told& a, const Told& b) { return a.score < b.score; });
  double distance = 0.0;
  for (std::size_t i = 0; i < told.size(); ++i) {
    distance = std::max(distance, std::abs(told[i].score - (static_cast<double>(i) + 0.5) / n));
  }
  // Of a right pose, fits as bad as that are as rare as they should be; the scores in the middle
  // are higher than uniform ones by up to a tenth, since what does not gate is no innovation.
  EXPECT_LT(distance, 0.12);
  const auto bad =
      std::count_if(told.begin(), told.end(), [](const Told& t) { return t.score < 0.05; });
  EXPECT_LT(static_cast<double>(bad), 0.08 * n);
  EXPECT_GT(static_cast<double>(bad), 0.005 * n);
  EXPECT_NEAR(static_cast<double>(inside) / n, kProbability, 0.03);
}

TEST(TrustTest, ScoreIsLowSoonAfterTheVehicleWasCarriedUntilItIsFound) {
  constexpr double kCarriedAtS = 20.0;
  constexpr double kSoonS = 1.0;
  constexpr int kCarried = 40;
  std::vector<double> wrong;
  std::vector<double> before;
  for (int i = 0; i < kCarried; ++i) {
    for (const Told& told : Drive(static_cast<std::uint64_t>(200 + i), 18.0, 0.5, kCarriedAtS)) {
      if (told.time_s < kCarriedAtS) before.push_back(told.score);
      const bool is_wrong = told.error_m > 1.0 && told.state != LocalizerState::kLost;
      if (told.time_s >= kCarriedAtS + kSoonS && is_wrong) wrong.push_back(told.score);
    }
  }
  ASSERT_GT(wrong.size(), 60u);
  std::sort(wrong.begin(), wrong.end());
  std::sort(before.begin(), before.end());
  // Of landmarks that are few, one or two that fail may have moved.
  EXPECT_LT(wrong[wrong.size() / 2], 0.05);
  EXPECT_LT(wrong[wrong.size() * 9 / 10], 0.2);
  EXPECT_GT(before[before.size() / 2], 0.4);
}

}  // namespace
}  // namespace shiftmap::live
