// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/map_difference.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "mapstore/geometry/se2.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;

LandmarkGroup Group(const std::string& signature,
                    const std::vector<Eigen::Vector2d>& places,
                    const Eigen::VectorXd& probabilities) {
  LandmarkGroup group;
  group.signature = Signature(signature);
  for (const Eigen::Vector2d& place : places) {
    Mode mode;
    mode.number = group.NextNumber();
    mode.p_map_landmark = place;
    group.modes.push_back(mode);
  }
  group.chain = ModeChain::Uniform(static_cast<int>(places.size()), 1e-5);
  group.probabilities = probabilities;
  return group;
}

std::vector<LandmarkGroup> Reference() {
  return {Group("1", {{0.0, 0.0}, {5.0, 1.0}}, Eigen::Vector3d(0.01, 0.98, 0.01)),
          Group("2", {{3.0, 7.0}}, Eigen::Vector2d(0.1, 0.9)),
          Group("3", {{-4.0, 2.0}}, Eigen::Vector2d(0.02, 0.98))};
}

TEST(CompareMaps, AFrameAndAnOrderOfModesAreNoDifference) {
  const std::vector<LandmarkGroup> reference = Reference();
  std::vector<LandmarkGroup> map = reference;
  std::swap(map[0].modes[0].p_map_landmark, map[0].modes[1].p_map_landmark);
  map[0].probabilities = Eigen::Vector3d(0.01, 0.01, 0.98);
  const Se2 T(20.0, -3.0, 2.0);
  for (LandmarkGroup& group : map) {
    for (Mode& mode : group.modes) mode.p_map_landmark = T * mode.p_map_landmark;
  }
  const StatusOr<MapDifference> difference = CompareMaps(reference, map);
  ASSERT_THAT(difference, IsOk());
  EXPECT_EQ(difference->modes, 4);
  EXPECT_EQ(difference->missing_modes, 0);
  EXPECT_EQ(difference->added_modes, 0);
  EXPECT_LT(difference->position_max_m, 1e-9);
  EXPECT_EQ(difference->sure, 2);
  EXPECT_EQ(difference->other_state, 0);
  EXPECT_NEAR(difference->variation_max, 0.0, 1e-12);
  EXPECT_EQ(difference->log_rate_ratios, std::vector<double>(3, 0.0));
}

TEST(CompareMaps, WhatDiffersIsCounted) {
  const std::vector<LandmarkGroup> reference = Reference();
  std::vector<LandmarkGroup> map = reference;
  map[0].modes[1].p_map_landmark += Eigen::Vector2d(0.0, 9.0);  // Another mode instead of this.
  map[0].probabilities = Eigen::Vector3d(0.0, 0.2, 0.8);
  map[2].chain = ModeChain::Uniform(1, 2e-5);
  map[2].probabilities = Eigen::Vector2d(0.32, 0.68);
  const StatusOr<MapDifference> difference = CompareMaps(reference, map);
  ASSERT_THAT(difference, IsOk());
  EXPECT_EQ(difference->missing_modes, 1);
  EXPECT_EQ(difference->added_modes, 1);
  EXPECT_EQ(difference->sure, 2);
  EXPECT_EQ(difference->other_state, 1);
  // Of the first group ½ (0.01 + 0.78 + 0.01 + 0.8), of the last one 0.3.
  EXPECT_NEAR(difference->variation_max, 0.8, 1e-12);
  EXPECT_NEAR(difference->variation, (0.8 + 0.3) / 3.0, 1e-12);
  EXPECT_NEAR(difference->log_rate_ratios[2], std::log(2.0), 1e-12);
}

}  // namespace
}  // namespace shiftmap
