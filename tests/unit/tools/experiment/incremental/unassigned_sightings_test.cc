// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/unassigned_sightings.h"

#include <gtest/gtest.h>

namespace shiftmap {
namespace {

constexpr double kGate = 9.21;  // 99 % of two degrees of freedom.

// One frame more at the origin, which sees a landmark along x.
void See(int group, int mode, double range_m, double sd_m, Window* window) {
  WindowObservation seen;
  seen.group = group;
  seen.mode = mode;
  seen.factor.observation.z = {range_m, 0.0};
  seen.cov_p_map = Eigen::Matrix2d::Identity() * (sd_m * sd_m);
  window->frames.emplace_back();
  window->frames.back().observations.push_back(seen);
}

TEST(UnassignedSightingsTest, AreThoseWithoutAModeThatAgreeWithTheNewest) {
  Window window;
  See(0, kNoMode, 3.0, 0.1, &window);
  See(0, 2, 3.0, 0.1, &window);        // Has a mode.
  See(1, kNoMode, 3.0, 0.1, &window);  // Another landmark.
  See(0, kNoMode, 5.0, 0.1, &window);  // Elsewhere.
  See(0, kNoMode, 3.2, 0.1, &window);
  const std::vector<UnassignedSighting> found = AgreeingSightings(window, 0, kGate);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].frame, 0);
  EXPECT_EQ(found[1].frame, 4);
  EXPECT_TRUE(found[1].p_map_landmark.isApprox(Eigen::Vector2d(3.2, 0.0)));
}

TEST(UnassignedSightingsTest, AnUncertainOneAgreesFromFartherAway) {
  Window window;
  See(0, kNoMode, 3.0, 0.1, &window);
  See(0, kNoMode, 5.0, 1.0, &window);
  const std::vector<UnassignedSighting> found = AgreeingSightings(window, 0, kGate);
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(SharpestSighting(found).frame, 0);
}

TEST(UnassignedSightingsTest, ThereMayBeNone) {
  Window window;
  See(1, kNoMode, 3.0, 0.1, &window);
  EXPECT_TRUE(AgreeingSightings(window, 0, kGate).empty());
}

}  // namespace
}  // namespace shiftmap
