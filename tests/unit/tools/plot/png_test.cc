// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/png.h"

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

std::string Picture(const std::string& color) {
  Svg svg(200.0, 100.0);
  svg.Line({10.0, 10.0}, {190.0, 90.0}, {.stroke = color, .stroke_width = 4.0});
  return svg.ToString();
}

// A number of the header, which begins at byte 16: width, then height.
std::uint32_t HeaderNumber(const std::string& png, std::size_t index) {
  std::uint32_t value = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    value = (value << 8U) | static_cast<unsigned char>(png[16 + 4 * index + i]);
  }
  return value;
}

TEST(Png, HasTheSizeAskedFor) {
  const StatusOr<std::string> png = RenderPng(Picture("#000000"), 640);
  ASSERT_THAT(png, IsOk());
  EXPECT_EQ(png->substr(0, 8), "\x89PNG\r\n\x1a\n");
  EXPECT_EQ(HeaderNumber(*png, 0), 640U);
  EXPECT_EQ(HeaderNumber(*png, 1), 320U);
}

TEST(Png, IsTwiceAsLargeAsTheSvgByDefault) {
  const StatusOr<std::string> png = RenderPng(Picture("#000000"));
  ASSERT_THAT(png, IsOk());
  EXPECT_EQ(HeaderNumber(*png, 0), 400U);
  EXPECT_EQ(HeaderNumber(*png, 1), 200U);
}

TEST(Png, ShowsWhatTheSvgShows) {
  const StatusOr<std::string> black = RenderPng(Picture("#000000"));
  const StatusOr<std::string> again = RenderPng(Picture("#000000"));
  const StatusOr<std::string> white = RenderPng(Picture("#ffffff"));
  ASSERT_THAT(black, IsOk());
  ASSERT_THAT(again, IsOk());
  ASSERT_THAT(white, IsOk());
  EXPECT_EQ(*black, *again);
  EXPECT_NE(*black, *white);
}

TEST(Png, RefusesWhatIsNoPicture) {
  EXPECT_THAT(RenderPng("not a picture", 100), StatusIs(StatusCode::kInvalidArgument, "picture"));
  Svg tall(10.0, 5000.0);
  EXPECT_THAT(RenderPng(tall.ToString(), 1000), StatusIs(StatusCode::kInvalidArgument, "picture"));
}

}  // namespace
}  // namespace shiftmap
