// SPDX-License-Identifier: Apache-2.0
//
// A vehicle stands 3 m from a landmark, on one side of it after the other, and sees nothing.
#include "localizer/monitor/missed_passes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <optional>
#include <vector>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

constexpr double kPassS = 5.0;
constexpr double kApartS = 8.0;  // Between passes.
constexpr double kScanS = 0.25;

class MissedPassesTest : public ::testing::Test {
 protected:
  MissedPassesTest() {
    content_ = MakeTwoModeMap(1, 10.0, 1);
    LandmarkGroup& group = content_.groups[0];
    group.modes.resize(1);
    group.modes[0].p_map_landmark.setZero();
    group.chain = ModeChain::Uniform(1, 1e-6);
    group.probabilities = Eigen::Vector2d(0.05, 0.95);
    content_.covariance = JointCovariance({group.modes[0].cov_p_map_landmark}, {});
    content_.calibration.sensor.detection_probability = 0.8;
  }

  // How often the landmark is found gone over passes from these directions, and is seen once, by
  // chance, in pass `seen`.
  // @param wall_m  How far a lidar sees in every direction; nothing: there is none.
  // @param stands  The pass in which it is back, and seen all the time.
  int Gone(const std::vector<double>& directions_rad,
           int seen = -1,
           std::optional<float> wall_m = std::nullopt,
           int stands = -1) {
    LidarView lidar;
    lidar.counts = wall_m.has_value();
    lidar.scan.ranges_m.assign(181, wall_m.value_or(0.0f));
    const MapSnapshot snapshot = Snapshot(content_);
    MissedPasses missed(snapshot);
    HypothesisOptions options;
    options.field_of_view.own = false;
    int gone = 0;
    double t = 0.0;
    for (std::size_t pass = 0; pass < directions_rad.size(); ++pass, t += kApartS) {
      const Se2 turned(0.0, 0.0, directions_rad[pass]);
      const PoseWithCovariance pose{turned * Se2(-3.0, 0.0, 0.0),
                                    Eigen::Vector3d(1e-4, 1e-4, 1e-4).asDiagonal()};
      HypothesisBank bank(snapshot, options, pose, StampFromSeconds(1000.0 + t));
      for (double end = t + kPassS; t < end; t += kScanS) {
        Scan scan;
        scan.stamp = StampFromSeconds(1000.0 + t);
        if ((static_cast<int>(pass) == seen && t + 1.0 > end) || static_cast<int>(pass) == stands) {
          Observation observation;
          observation.signature = content_.groups[0].signature;
          observation.z = {3.0, 0.0};
          scan.observations.push_back(observation);
        }
        bank.Correct(scan, &lidar);
        gone += static_cast<int>(missed.Add(scan, bank, snapshot).size());
      }
    }
    return gone;
  }

  MapContent content_;
};

constexpr double kThird = 2.0 * M_PI / 3.0;

TEST_F(MissedPassesTest, ALandmarkMissedInThreePassesFromAllAroundIsGone) {
  EXPECT_EQ(Gone({0.1, 0.1 + kThird}), 0);
  EXPECT_EQ(Gone({0.1, 0.1 + kThird, 0.1 + 2.0 * kThird}), 1);
  // And said again after each further pass.
  EXPECT_EQ(Gone({0.1, 0.1 + kThird, 0.1 + 2.0 * kThird, 0.1}), 2);
}

TEST_F(MissedPassesTest, WhatTheMapHoldsForAbsentIsNoNews) {
  content_.groups[0].probabilities = Eigen::Vector2d(0.95, 0.05);
  EXPECT_EQ(Gone({0.1, 0.1 + kThird, 0.1 + 2.0 * kThird, 0.1}), 0);
}

TEST_F(MissedPassesTest, WhatCameBackAndWentAgainIsNews) {
  content_.groups[0].probabilities = Eigen::Vector2d(0.95, 0.05);
  const std::vector<double> directions = {0.1, 0.1, 0.1 + kThird, 0.1 + 2.0 * kThird};
  EXPECT_EQ(Gone(directions, -1, std::nullopt, 0), 1);
  EXPECT_EQ(Gone(directions, 0), 0);  // One sighting may be misread.
}

TEST_F(MissedPassesTest, ASignMissedFromBehindIsNot) {
  EXPECT_EQ(Gone({0.1, 0.9, 1.7, 0.1, 0.9, 1.7, 0.1, 0.9}), 0);
}

TEST_F(MissedPassesTest, WhatWasSeenStartsAgain) {
  EXPECT_EQ(Gone({0.1, 0.1 + kThird, 0.1 + 2.0 * kThird, 0.1}, 1), 0);
}

TEST_F(MissedPassesTest, WhatAWallHidesIsNotMissed) {
  const std::vector<double> all_around = {0.1, 0.1 + kThird, 0.1 + 2.0 * kThird};
  EXPECT_EQ(Gone(all_around, -1, 2.0f), 0);
  EXPECT_EQ(Gone(all_around, -1, 3.0f), 1);  // It would stand on the wall.
  EXPECT_EQ(Gone(all_around, -1, 20.0f), 1);
}

TEST_F(MissedPassesTest, OnePassIsBoundedEvidenceHoweverLong) {
  EXPECT_EQ(Gone(std::vector<double>(20, 0.1)), 0);
}

}  // namespace
}  // namespace shiftmap
