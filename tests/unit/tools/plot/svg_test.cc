// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/svg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "tests/scenario/well_formed.h"
#include "tests/unit/tools/plot/svg_picture.h"
#include "tools/plot/label_placer.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;

TEST(Svg, EscapesText) {
  Svg svg(100.0, 50.0);
  svg.Text({1.0, 2.0}, "a<b & \"c\" > d\x01", {});
  const std::string text = svg.ToString();
  EXPECT_EQ(testing::XmlDefect(text), "");
  EXPECT_THAT(text, HasSubstr("a&lt;b &amp; &quot;c&quot; &gt; d\\x01<"));
}

TEST(Svg, DrawsShapes) {
  Svg svg(100.0, 50.0);
  svg.Line({0.0, 0.0}, {1.0, 1.0}, {.stroke = "#000000"});
  svg.Polyline(std::vector<Eigen::Vector2d>{{0.0, 0.0}, {2.0, 3.0}}, {.stroke = "#000000"});
  svg.Circle({5.0, 5.0}, 2.0, {.fill = "#ff0000"}, "tip <1>");
  svg.Ellipse({5.0, 5.0}, {2.0, 1.0}, 1.5707963, {.fill = "#ff0000", .opacity = 0.5});
  svg.Rect({0.0, 0.0}, {3.0, 3.0}, {.stroke = "#000000", .dash = "4 3"});
  const std::string text = svg.ToString();
  EXPECT_EQ(testing::XmlDefect(text), "");
  EXPECT_THAT(text, HasSubstr("points=\"0.00,0.00 2.00,3.00 \""));
  EXPECT_THAT(text, HasSubstr("rotate(90.00)"));
  EXPECT_THAT(text, HasSubstr("<title>tip &lt;1&gt;</title>"));
  EXPECT_THAT(text, HasSubstr("viewBox=\"0 0 100 50\""));
}

TEST(Svg, TextOfAnyBytesIsNoMarkup) {
  Svg svg(100.0, 50.0);
  svg.Text({1.0, 20.0}, "]]><script>alert(1)</script>\xff\xfe\x1b[2J\xef\xbf\xbf\xe2\x80\xae", {});
  const std::string text = svg.ToString();
  EXPECT_EQ(testing::XmlDefect(text), "");
  EXPECT_EQ(testing::CountElements(text, "script"), 0);
  EXPECT_THAT(text, HasSubstr(R"(\xff\xfe\x1b[2J?\u202e)"));
}

TEST(PictureDefect, FindsWhatLeavesThePictureAndTextsThatOverlap) {
  const auto defect = [](const auto& draw) {
    Svg svg(100.0, 50.0);
    draw(&svg);
    return testing::PictureDefect(svg.ToString());
  };
  EXPECT_EQ(defect([](Svg* svg) { svg->Circle({50.0, 25.0}, 20.0, {}); }), "");
  EXPECT_NE(defect([](Svg* svg) { svg->Circle({90.0, 25.0}, 20.0, {}); }), "");
  EXPECT_NE(defect([](Svg* svg) { svg->Ellipse({50.0, 25.0}, {40.0, 5.0}, 1.5, {}); }), "");
  EXPECT_NE(defect([](Svg* svg) { svg->Circle({50.0, std::nan("")}, 20.0, {}); }), "");
  EXPECT_NE(defect([](Svg* svg) { svg->Text({80.0, 25.0}, "a long text", {}); }), "");
  EXPECT_NE(defect([](Svg* svg) {
              svg->Text({10.0, 25.0}, "one", {});
              svg->Text({20.0, 30.0}, "two", {});
            }),
            "");
}

TEST(Svg, TheEstimatedWidthIsThatOfTheFont) {
  for (const char* text : {"L07", "m2 97 %", "probabilities at 2026-01-09 08:05:00 UTC", "→ ×"}) {
    for (const bool bold : {false, true}) {
      Svg svg(1000.0, 20.0);
      const double width = Svg::TextWidth(text, 12.0, bold);
      svg.Text({1000.0 - width, 12.0}, text, {.bold = bold});
      // Too narrow an estimate leaves the picture; too wide a one wastes room.
      EXPECT_EQ(testing::PictureDefect(svg.ToString()), "") << text;
      EXPECT_LT(width, 1.2 * testing::WidthInFont(text, 12.0, bold)) << text;
    }
  }
}

TEST(Svg, ShortensToTheWidth) {
  EXPECT_EQ(Svg::Shortened("short", 12.0, 100.0), "short");
  const std::string cut = Svg::Shortened("ÄÖÜ a rather long name of a landmark", 12.0, 60.0);
  EXPECT_THAT(cut, ::testing::EndsWith("…"));
  EXPECT_THAT(cut, ::testing::StartsWith("ÄÖÜ"));
  EXPECT_LE(Svg::TextWidth(cut, 12.0), 60.0);
}

TEST(LabelPlacer, LabelsOverlapNothingAndStayInside) {
  LabelPlacer placer({-40.0, -40.0}, {40.0, 40.0});
  const Eigen::Vector2d size(20.0, 10.0);
  placer.Occupy({0.0, 0.0}, 2.0);
  placer.OccupyLine({0.0, 0.0}, {0.0, -40.0}, 4.0);
  std::vector<Eigen::Vector2d> placed;
  for (int i = 0; i < 40; ++i) {
    const auto at = placer.Place({0.0, 0.0}, 3.0, size, 5);
    if (!at) continue;
    EXPECT_GE(at->x(), -40.0);
    EXPECT_LE(at->x() + size.x(), 40.0);
    EXPECT_GE(at->y() - size.y(), -40.0);
    EXPECT_LE(at->y(), 40.0);
    const bool on_line = at->x() < 2.0 && at->x() + size.x() > -2.0 && at->y() - size.y() < 0.0;
    EXPECT_FALSE(on_line) << at->transpose();
    for (const Eigen::Vector2d& other : placed) {
      EXPECT_TRUE(std::abs(at->x() - other.x()) >= 20.0 || std::abs(at->y() - other.y()) >= 10.0);
    }
    placed.push_back(*at);
  }
  EXPECT_GE(placed.size(), 8U);
  EXPECT_LT(placed.size(), 40U);
}

}  // namespace
}  // namespace shiftmap
