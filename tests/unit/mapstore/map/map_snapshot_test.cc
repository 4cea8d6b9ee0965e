// SPDX-License-Identifier: Apache-2.0
#include "mapstore/map/map_snapshot.h"

#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <utility>
#include <vector>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

MapContent SomeContent() {
  std::mt19937_64 random(41);
  return RandomContent(random);
}

TEST(MapSnapshotTest, FindsGroupsAndModes) {
  const MapContent content = SomeContent();
  const MapSnapshot snapshot("a", VersionNumber(3), "hash", content);
  EXPECT_EQ(snapshot.area(), "a");
  EXPECT_EQ(snapshot.version(), VersionNumber(3));
  int mode_index = 0;
  for (int i = 0; i < static_cast<int>(content.groups.size()); ++i) {
    const LandmarkGroup& group = content.groups[static_cast<std::size_t>(i)];
    EXPECT_EQ(snapshot.GroupIndex(group.signature), i);
    for (int state = 1; state <= static_cast<int>(group.modes.size()); ++state) {
      EXPECT_EQ(snapshot.ModeIndex(i, state), mode_index++);
      EXPECT_EQ(group.StateOf(group.NumberOf(state)), state);
    }
  }
  EXPECT_EQ(snapshot.GroupIndex(Signature("none")), -1);
  EXPECT_EQ(content.groups[0].StateOf(ModeNumber(99)), -1);
  EXPECT_EQ(content.groups[0].StateOf(kAbsent), 0);
}

TEST(ValidateMapContentTest, AcceptsRandomAndEmptyContent) {
  EXPECT_THAT(ValidateMapContent(SomeContent()), IsOk());
  EXPECT_THAT(ValidateMapContent(MapContent{}), IsOk());
}

TEST(ValidateMapContentTest, NamesWhatIsWrong) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  struct Case {
    const char* message;
    std::function<void(MapContent&)> damage;
  };
  const std::vector<Case> cases = {
      {"signatures do not ascend", [](MapContent& c) { std::swap(c.groups[0], c.groups[1]); }},
      {"signatures do not ascend", [](MapContent& c) { c.groups[1] = c.groups[0]; }},
      {"empty signature", [](MapContent& c) { c.groups[0].signature = Signature(); }},
      {"no modes", [](MapContent& c) { c.groups[2].modes.clear(); }},
      {"mode number 0", [](MapContent& c) { c.groups[2].modes[0].number = kAbsent; }},
      {"position (nan", [=](MapContent& c) { c.groups[2].modes[0].p_map_landmark.x() = kNan; }},
      {"1e+300), expected finite",
       [](MapContent& c) { c.groups[2].modes[0].p_map_landmark.y() = 1e300; }},
      {"or above 1e+18", [](MapContent& c) { c.groups[2].modes[0].cov_p_map_landmark *= 1e30; }},
      {"leave rate 1e+308",
       [](MapContent& c) {
         c.groups[2].chain = ModeChain::Uniform(static_cast<int>(c.groups[2].modes.size()), 1e308);
       }},
      {"within 146 years", [](MapContent& c) { c.stamp = Stamp::max(); }},
      {"within 146 years", [](MapContent& c) { c.groups[2].modes[0].last_seen = Stamp::min(); }},
      {"not symmetric positive definite",
       [](MapContent& c) { c.groups[2].modes[0].cov_p_map_landmark.setZero(); }},
      {"not symmetric positive definite",
       [](MapContent& c) { c.groups[2].modes[0].cov_p_map_landmark(0, 1) += 1.0; }},
      {"chain has 6 states",
       [](MapContent& c) { c.groups[2].chain = ModeChain::Uniform(5, 1e-6); }},
      {"7 probabilities",
       [](MapContent& c) { c.groups[2].probabilities = Eigen::VectorXd::Constant(7, 1.0 / 7.0); }},
      {"not a distribution", [](MapContent& c) { c.groups[2].probabilities *= 1.001; }},
      {"disagrees with the marginal",
       [](MapContent& c) { c.groups[2].modes[0].cov_p_map_landmark *= 1.001; }},
      {"joint covariance", [](MapContent& c) { c.groups.pop_back(); }},
      {"anonymous landmark",
       [=](MapContent& c) { c.anonymous_landmarks[0].p_map_landmark.y() = kNan; }},
      {"odometry calibration", [](MapContent& c) { c.calibration.odometry.scale_v = 0.0; }},
      {"odometry calibration", [](MapContent& c) { c.calibration.odometry.lag_s = 1e300; }},
      {"sensor calibration", [](MapContent& c) { c.calibration.sensor.sd_range_m = 1e-200; }},
      {"sensor calibration",
       [](MapContent& c) { c.calibration.sensor.detection_probability = 1.0; }}};
  for (const Case& wrong : cases) {
    MapContent content = SomeContent();
    wrong.damage(content);
    EXPECT_THAT(ValidateMapContent(content), StatusIs(StatusCode::kInvalidArgument, wrong.message));
  }
}

}  // namespace
}  // namespace shiftmap::testing
