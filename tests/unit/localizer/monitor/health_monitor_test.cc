// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/health_monitor.h"

#include <gtest/gtest.h>

#include <optional>
#include <utility>

namespace shiftmap {
namespace {

constexpr double kScanS = 0.25;

Stamp At(double seconds) { return StampFromSeconds(1000.0 + seconds); }

PoseSupport SupportOf(int agreeing, int failing, double nis_sum, int updates) {
  PoseSupport support;
  support.agreeing = agreeing;
  support.failing = failing;
  support.nis_sum = nis_sum;
  support.updates = updates;
  return support;
}

// A scan in which the first `agreeing` of four groups agree and the rest fail.
void AddScan(double seconds, int agreeing, const FailingPairs& pairs, HealthMonitor* health) {
  health->AddPairs(At(seconds), pairs);
  for (int group = 0; group < 4; ++group) {
    const bool explained = group < agreeing;
    health->Add(At(seconds), group, explained, explained ? std::optional(2.0) : std::nullopt);
  }
  health->Judge();
}

TEST(PoseSupport, ConfirmsIfThreeAgreeAndTwoMoreThanTwiceThoseThatFail) {
  EXPECT_FALSE(SupportOf(2, 0, 4.0, 2).Confirms());
  EXPECT_TRUE(SupportOf(3, 0, 6.0, 3).Confirms());
  EXPECT_FALSE(SupportOf(3, 1, 6.0, 3).Confirms());
  EXPECT_TRUE(SupportOf(4, 1, 8.0, 4).Confirms());
}

TEST(PoseSupport, DoesNotAgreeWithInnovationsThatAreTooLarge) {
  // χ² of 8 degrees of freedom: 0.02 of it is above 18.2; four innovations count nearly as that.
  EXPECT_TRUE(SupportOf(4, 1, 16.0, 4).Agrees());
  EXPECT_FALSE(SupportOf(4, 1, 20.0, 4).Agrees());
  EXPECT_FALSE(SupportOf(4, 4, 8.0, 4).Agrees());
}

TEST(HealthMonitor, CountsTheLastObservationOfEachGroup) {
  HealthMonitor health(4);
  health.Add(At(0.0), 0, true, 1.0);
  health.Add(At(0.0), 1, false, std::nullopt);
  health.Add(At(1.0), 0, false, std::nullopt);
  health.Add(At(1.0), 2, true, 3.0);
  const PoseSupport all = health.Support();
  EXPECT_EQ(all.agreeing, 1);
  EXPECT_EQ(all.failing, 2);
  EXPECT_EQ(all.turned, 1);
  EXPECT_EQ(all.updates, 2);
  EXPECT_DOUBLE_EQ(all.nis_sum, 4.0);
  const PoseSupport late = health.Support(At(0.5), 2);
  EXPECT_EQ(late.agreeing, 0);
  EXPECT_EQ(late.failing, 1);
  EXPECT_EQ(late.since, At(1.0));
}

TEST(HealthMonitor, AVehicleIsLostWhenNothingAgreesForTwentySeconds) {
  HealthMonitor health(4);
  for (double t = 0.0; t < 20.0; t += kScanS) {
    AddScan(t, 0, {}, &health);
    ASSERT_FALSE(health.lost()) << t;
  }
  AddScan(20.0, 0, {}, &health);
  EXPECT_TRUE(health.lost());
  EXPECT_EQ(health.failing_since(), At(0.0));
  // Found when half of the last twenty observations agree.
  for (double t = 20.25; t < 21.0; t += kScanS) AddScan(t, 4, {}, &health);
  EXPECT_FALSE(health.lost());
}

TEST(HealthMonitor, WhatItTakesToBeLostIsAnOption) {
  // Landmarks fail for 30 s, eight of ten pairs as in the map, then three of four agree.
  const auto lost_and_found = [](const HealthOptions& options, int agreeing) {
    HealthMonitor health(4, options);
    for (double t = 0.0; t < 30.0; t += kScanS)
      AddScan(t, agreeing, {.pairs = 10, .as_in_map = 8}, &health);
    const bool lost = health.lost();
    for (double t = 30.0; t < 35.0; t += kScanS) AddScan(t, 3, {}, &health);
    return std::pair(lost, lost && !health.lost());
  };
  EXPECT_EQ(lost_and_found({}, 0), std::pair(true, true));
  EXPECT_EQ(lost_and_found({.lost_s = 40.0}, 0).first, false);
  EXPECT_EQ(lost_and_found({.min_observations = 1000}, 0).first, false);
  EXPECT_EQ(lost_and_found({.min_pair_share = 0.9}, 0).first, false);
  EXPECT_EQ(lost_and_found({.min_pairs = 2000, .min_pair_share = 0.9}, 0).first, true);
  EXPECT_EQ(lost_and_found({.found_share = 0.9}, 0), std::pair(true, false));
  EXPECT_EQ(lost_and_found({}, 1).first, false);
  EXPECT_EQ(lost_and_found({.lost_share = 0.3}, 1).first, true);
}

TEST(HealthMonitor, WhatAgreedBeforeDoesNotFindALostVehicle) {
  HealthMonitor health(4);
  for (double t = 0.0; t < 10.0; t += kScanS) AddScan(t, 4, {}, &health);
  health.DeclareLost(At(10.0));
  for (int scan = 0; scan < 4; ++scan) {
    AddScan(10.0 + scan * kScanS, 4, {}, &health);
    EXPECT_TRUE(health.lost()) << scan;
  }
  AddScan(11.0, 4, {}, &health);  // The twentieth observation since.
  EXPECT_FALSE(health.lost());
}

TEST(HealthMonitor, TwoLandmarksFindNoLostVehicle) {
  HealthMonitor health(4);
  health.DeclareLost(At(0.0));
  for (double t = 0.0; t < 30.0; t += kScanS) {
    for (int group = 0; group < 2; ++group) health.Add(At(t), group, true, 2.0);
    health.Judge();
    ASSERT_TRUE(health.lost()) << t;
  }
  health.Add(At(30.0), 2, true, 2.0);
  health.Judge();
  EXPECT_FALSE(health.lost());
}

TEST(HealthMonitor, AVehicleIsNotLostWhileOneOfFourAgrees) {
  HealthMonitor health(4);
  for (double t = 0.0; t < 60.0; t += kScanS) AddScan(t, 1, {}, &health);
  EXPECT_FALSE(health.lost());
}

// Landmarks that moved agree with a pose at the places where that pose has them: they do not prove
// it. If each has moved with probability 1/3, five of five have with 0.4 %, six of seven with 0.7 %
// and five of six with 1.8 %.
TEST(HealthMonitor, LandmarksThatMovedDoNotProveThePose) {
  const auto unproven = [](int at_modes, int moved, double seconds) {
    HealthMonitor health(20);
    int group = 0;
    for (; group < at_modes; ++group) health.Add(At(0.0), group, true, 2.0);
    for (; group < at_modes + moved; ++group) {
      health.Add(At(seconds), group, true, std::nullopt);
      health.Judge();
    }
    return health.unproven().has_value();
  };
  EXPECT_FALSE(unproven(0, 4, 0.0));
  EXPECT_TRUE(unproven(0, 5, 0.0));
  EXPECT_FALSE(unproven(1, 5, 0.0));
  EXPECT_TRUE(unproven(1, 6, 0.0));
  EXPECT_FALSE(unproven(2, 6, 0.0));
  EXPECT_TRUE(unproven(2, 7, 0.0));
  // Three that agree prove it, as many as have moved.
  EXPECT_FALSE(unproven(3, 17, 0.0));
  // What agreed two minutes ago says nothing of the pose now.
  EXPECT_FALSE(unproven(5, 5, 59.0));
  EXPECT_TRUE(unproven(5, 5, 120.0));
}

TEST(HealthMonitor, LandmarksThatDoNotKeepTheirDistancesMoved) {
  HealthMonitor health(4);
  for (double t = 0.0; t < 60.0; t += kScanS) AddScan(t, 0, {6, 1}, &health);
  EXPECT_FALSE(health.lost());
}

}  // namespace
}  // namespace shiftmap
