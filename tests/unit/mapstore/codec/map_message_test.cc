// SPDX-License-Identifier: Apache-2.0
#include "mapstore/codec/map_message.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <string>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

constexpr MapForm kForms[] = {MapForm::kBinary, MapForm::kText, MapForm::kJson};

// Everything that a map can have: rates that differ, a retired mode, odd names.
MapContent FullContent() {
  std::mt19937_64 random(testing::TestSeed(5));
  MapContent content = testing::RandomContent(random, {.groups = 6, .vehicles = 2, .rhythms = 2});
  content.groups[0] = testing::RandomGroup(random, "\x1b[2J\n\"<b>é\u009b", 2);
  Eigen::Matrix3d rates;
  rates << -3e-5, 1e-5, 2e-5, 0.1e-5, -0.4e-5, 0.3e-5, 7e-6, 0.0, -7e-6;
  content.groups[0].chain = *ModeChain::FromRates(rates);
  content.groups[0].merged = {{ModeNumber(7), ModeNumber(2)}};
  std::vector<Eigen::Matrix2d> diagonal;
  for (const LandmarkGroup& group : content.groups) {
    for (const Mode& mode : group.modes) diagonal.push_back(mode.cov_p_map_landmark);
  }
  Eigen::Matrix2d cross;
  cross << 1e-5, 2e-5, 3e-5, 0.1 + 0.2;
  content.covariance = JointCovariance(diagonal, {{0, 3, cross}});
  return content;
}

MapSnapshot FullMap() {
  return MapSnapshot("hall", VersionNumber(3), std::string(64, 'c'), FullContent());
}

TEST(MapMessage, ComesBackBitByBitInEveryForm) {
  const MapSnapshot map = FullMap();
  for (const MapForm form : kForms) {
    const auto text = EncodeMap(map, form);
    ASSERT_THAT(text, IsOk());
    const auto decoded = DecodeMap(*text, form);
    ASSERT_THAT(decoded, IsOk());
    EXPECT_EQ(ContentHash(decoded->content()), ContentHash(map.content()));
    EXPECT_EQ(decoded->stamp(), map.stamp());
    EXPECT_EQ(decoded->area(), "hall");
    EXPECT_EQ(decoded->version().value(), 3);
    EXPECT_EQ(decoded->content_hash(), map.content_hash());
    EXPECT_EQ(*EncodeMap(*decoded, form), *text);
  }
}

TEST(MapMessage, TextFormsHoldNoControlCharacterOfAName) {
  for (const MapForm form : {MapForm::kText, MapForm::kJson}) {
    const std::string text = *EncodeMap(FullMap(), form);
    EXPECT_EQ(text.find('\x1b'), std::string::npos);
    EXPECT_EQ(text.find("\xc2\x9b"), std::string::npos);
    EXPECT_EQ(text.find("<b>"), form == MapForm::kText ? text.find("\\\"<b>") + 2 : text.npos);
  }
}

TEST(MapMessage, ErrorsNameThePlaceOrTheLandmark) {
  EXPECT_THAT(DecodeMap("area: \"a\"\nversion: x", MapForm::kText),
              StatusIs(StatusCode::kInvalidArgument, "2:10"));
  EXPECT_THAT(DecodeMap("{\"area\": ", MapForm::kJson),
              StatusIs(StatusCode::kInvalidArgument, "JSON"));
  EXPECT_THAT(DecodeMap("{\"aera\": 1}", MapForm::kJson),
              StatusIs(StatusCode::kInvalidArgument, "aera"));
  EXPECT_THAT(DecodeMap("group { signature: 'L1' mode { mode: 1 cov_xx_m2: -1 } probability: 0 "
                        "probability: 1 }",
                        MapForm::kText),
              StatusIs(StatusCode::kInvalidArgument, "L1"));
}

TEST(MapMessage, HostileNumbersAreRefused) {
  const std::string group =
      "signature: 'L1' mode { mode: 1 cov_xx_m2: 1 cov_yy_m2: 1 } probability: 0 probability: 1 ";
  const auto decode = [&](const std::string& more, const std::string& outside = "") {
    return DecodeMap("group { " + group + more + "} " + outside, MapForm::kText).status();
  };
  EXPECT_THAT(decode("leave_rate_per_s: 1e-5"), IsOk());
  for (const char* rates : {"leave_rate_per_s: -1",
                            "leave_rate_per_s: nan",
                            "leave_rate_per_s: inf",
                            "rate_per_s: 1",
                            "rate_per_s: [-1e300, 1e300, 1e300, -1e300]",
                            "rate_per_s: [-inf, inf, 1, -1]",
                            "retired { mode: 1 into: 1 }"}) {
    EXPECT_THAT(decode(rates), StatusIs(StatusCode::kInvalidArgument, "")) << rates;
  }
  for (const char* block : {"cross_covariance { row: 0 column: 1 cov_m2: [0, 0, 0, 0] }",
                            "cross_covariance { row: -1 column: 0 cov_m2: [0, 0, 0, 0] }",
                            "cross_covariance { row: 0 column: 0 cov_m2: [0] }",
                            "stamp_ns: 9223372036854775807",
                            "calibration { odometry_scale_v: nan }",
                            "vehicle { vehicle: 'v' }"}) {
    EXPECT_THAT(decode("", block), StatusIs(StatusCode::kInvalidArgument, "")) << block;
  }
}

TEST(MapMessage, ANameThatIsNoTextIsRefused) {
  MapContent content = FullContent();
  content.groups.back().signature = Signature("\xff");
  EXPECT_THAT(EncodeMap(MapSnapshot("hall", VersionNumber(1), "", content), MapForm::kJson),
              StatusIs(StatusCode::kInvalidArgument, "UTF-8"));
}

}  // namespace
}  // namespace shiftmap
