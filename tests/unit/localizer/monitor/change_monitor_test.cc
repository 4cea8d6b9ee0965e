// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/change_monitor.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

constexpr int kMoved = 0;
constexpr int kGroups = 6;
constexpr double kScanS = 0.5;

Stamp At(double seconds) { return StampFromSeconds(1000.0 + seconds); }

// What is seen of the other landmarks.
void AddOthers(double seconds, bool agree, HealthMonitor* health) {
  for (int group = 1; group < kGroups; ++group) {
    health->Add(At(seconds), group, agree, agree ? std::optional(2.0) : std::nullopt);
  }
}

class ChangeMonitorTest : public ::testing::Test {
 protected:
  // The landmark fails, seen at one place from apart since `first`.
  bool Found(double first, double seconds) {
    health_.Add(At(seconds), kMoved, false, std::nullopt);
    SightingCollector::PlaceState place;
    place.count = ++sightings_;
    place.first = At(first);
    place.last = At(seconds);
    place.from_apart = true;
    return changes_.Sighted(kMoved, place, health_).has_value();
  }

  HealthMonitor health_{kGroups};
  ChangeMonitor changes_{kGroups, 3};
  int sightings_ = 0;
};

TEST_F(ChangeMonitorTest, ALandmarkMovedWhenOthersAgreeForThreeSeconds) {
  for (double t = 0.0; t < 3.0; t += kScanS) {
    AddOthers(t, true, &health_);
    EXPECT_FALSE(Found(0.0, t)) << t;
  }
  AddOthers(3.0, true, &health_);
  EXPECT_TRUE(Found(0.0, 3.0));
}

TEST_F(ChangeMonitorTest, APoseThatWentWrongLatelyConfirmsNothing) {
  for (double t = 0.0; t < 2.5; t += kScanS) {
    AddOthers(t, true, &health_);
    EXPECT_FALSE(Found(0.0, t));
  }
  for (double t = 2.5; t < 10.0; t += kScanS) {
    AddOthers(t, false, &health_);
    EXPECT_FALSE(Found(0.0, t)) << t;
  }
}

TEST_F(ChangeMonitorTest, AnOldMisreadSignatureIsNoBeginning) {
  AddOthers(0.0, true, &health_);
  EXPECT_FALSE(Found(0.0, 0.0));
  changes_.Explained(kMoved);
  for (double t = 10.0; t < 13.0; t += kScanS) {
    AddOthers(t, true, &health_);
    EXPECT_FALSE(Found(0.0, t)) << t;
  }
  AddOthers(13.0, true, &health_);
  EXPECT_TRUE(Found(0.0, 13.0));
}

TEST_F(ChangeMonitorTest, ALandmarkIsGoneWhenOthersAgreeThreeSecondsLater) {
  changes_.Missed(kMoved, At(0.0));
  for (double t = 0.0; t < 3.0; t += kScanS) {
    AddOthers(t, true, &health_);
    EXPECT_FALSE(changes_.TakeGone(health_, At(t))) << t;
  }
  AddOthers(3.0, true, &health_);
  const auto gone = changes_.TakeGone(health_, At(3.0));
  ASSERT_TRUE(gone);
  EXPECT_EQ(gone->group, kMoved);
  EXPECT_EQ(gone->support.agreeing, kGroups - 1);
  EXPECT_FALSE(changes_.TakeGone(health_, At(3.0)));  // Said once.
}

TEST_F(ChangeMonitorTest, WhatIsSeenAgainIsNotGone) {
  changes_.Decided(kMoved, true, At(0.0));
  changes_.Explained(kMoved);
  for (double t = 0.0; t < 6.0; t += kScanS) AddOthers(t, true, &health_);
  EXPECT_FALSE(changes_.TakeGone(health_, At(6.0)));
}

}  // namespace
}  // namespace shiftmap
