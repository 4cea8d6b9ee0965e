// SPDX-License-Identifier: Apache-2.0
//
// Are decisions wrong as often as α says, and not much less? Over visits drawn from the localizer's
// own model: map, prior, pose, odometry, sensor, occlusions, false alarms. More of them:
// shiftmap-experiment localizer-decisions.
#include <gtest/gtest.h>

#include <string>

#include "tools/experiment/localizer_decisions.h"

namespace shiftmap {
namespace {

// Of the interval of a share, so that one in a hundred thousand tests fails by chance.
constexpr double kSigmas = 4.3;

struct Point {
  double alpha = 0.1;
  double sd_pose_m = 0.1;
  int modes = 2;
  double clutter_density_per_m2 = 1e-4;
  int visits = 400;
};

class DecisionCalibration : public ::testing::TestWithParam<Point> {};

TEST_P(DecisionCalibration, WrongDecisionsAreAsRareAsPromised) {
  const Point& point = GetParam();
  VisitScene scene;
  scene.sd_pose_m = point.sd_pose_m;
  scene.sd_yaw_rad = 0.02 + 0.08 * point.sd_pose_m;
  scene.modes = point.modes;
  scene.clutter_density_per_m2 = point.clutter_density_per_m2;
  HypothesisOptions options;
  options.alpha = point.alpha;
  const DecisionTally tally = TallyDecisions(scene, options, 1, point.visits, 1);
  RecordProperty("wrong_share", std::to_string(tally.WrongShare()));
  RecordProperty("undecided_share", std::to_string(tally.UndecidedShare()));
  RecordProperty("mean_delay", std::to_string(tally.MeanDelay()));
  RecordProperty("wald_bound", std::to_string(tally.WaldDelay()));

  ASSERT_GT(tally.decided, point.visits);
  const Interval interval = IntervalOf(tally.Wrong(), kSigmas);
  EXPECT_LE(interval.low, point.alpha) << tally.wrong << " of " << tally.decided;
  EXPECT_GE(interval.high, point.alpha / 5.0) << tally.wrong << " of " << tally.decided;
  EXPECT_GE(tally.MeanDelay(), tally.WaldDelay());
}

// Where nothing was seen for a while the pose is vague, and wheels may have slipped.
struct BlindPoint {
  double blind_s = 5.0;
  double slip_share = 0.0;
};

class BlindDecisionCalibration : public ::testing::TestWithParam<BlindPoint> {};

TEST_P(BlindDecisionCalibration, WrongDecisionsAreAsRareAsPromisedAfterABlindDrive) {
  constexpr double kAlpha = 0.01;
  constexpr int kVisits = 400;
  VisitScene scene;
  scene.modes = 3;
  scene.blind_s = GetParam().blind_s;
  scene.slip_share = GetParam().slip_share;
  scene.alone_scans = 10;
  HypothesisOptions options;
  options.alpha = kAlpha;
  const DecisionTally tally = TallyDecisions(scene, options, 1, kVisits, 1);
  RecordProperty("wrong_share", std::to_string(tally.WrongShare()));
  RecordProperty("mean_delay", std::to_string(tally.MeanDelay()));

  ASSERT_GT(tally.decided, kVisits);
  EXPECT_LE(IntervalOf(tally.Wrong()).low, kAlpha) << tally.wrong << " of " << tally.decided;
  EXPECT_LT(tally.MeanDelay(), 8.0);
}

INSTANTIATE_TEST_SUITE_P(Visits,
                         BlindDecisionCalibration,
                         ::testing::Values(BlindPoint{5.0, 0.1},
                                           BlindPoint{15.0, 0.1},
                                           BlindPoint{60.0, 0.0}));

std::string NameOf(const ::testing::TestParamInfo<Point>& info) {
  const Point& point = info.param;
  const auto millimetres = static_cast<int>(1000.0 * point.sd_pose_m);
  return "alpha" + std::to_string(static_cast<int>(1.0 / point.alpha)) + "_sd" +
         std::to_string(millimetres) + "mm_modes" + std::to_string(point.modes) + "_clutter" +
         std::to_string(static_cast<int>(1e4 * point.clutter_density_per_m2));
}

INSTANTIATE_TEST_SUITE_P(Visits,
                         DecisionCalibration,
                         ::testing::Values(Point{0.1, 0.02, 2},
                                           Point{0.1, 0.3, 4},
                                           Point{0.1, 1.0, 2, 1e-3},
                                           Point{0.1, 1.0, 4},
                                           Point{0.01, 0.02, 4},
                                           Point{0.01, 0.1, 3, 1e-3},
                                           Point{0.01, 1.0, 2},
                                           Point{0.01, 1.0, 4},
                                           Point{0.001, 0.1, 4},
                                           Point{0.001, 1.0, 2}),
                         NameOf);

}  // namespace
}  // namespace shiftmap
