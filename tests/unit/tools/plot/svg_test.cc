// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/svg.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>
#include <vector>

#include "tests/support/random_map.h"
#include "tools/plot/label_placer.h"
#include "tools/plot/map_plot.h"

namespace shiftmap {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using ::testing::Not;

// True if every element that is opened is closed in order, and all text is escaped. Knows as much
// XML as these pictures use.
bool IsWellFormed(const std::string& xml) {
  std::vector<std::string> open;
  for (std::size_t at = xml.find('<'); at != std::string::npos; at = xml.find('<', at + 1)) {
    const std::size_t end = xml.find('>', at);
    if (end == std::string::npos || xml.find('<', at + 1) < end) return false;
    const std::string tag = xml.substr(at + 1, end - at - 1);
    if (tag.starts_with('?')) continue;
    if (tag.starts_with('/')) {
      if (open.empty() || open.back() != tag.substr(1)) return false;
      open.pop_back();
    } else if (!tag.ends_with('/')) {
      open.push_back(tag.substr(0, tag.find(' ')));
    }
  }
  for (std::size_t at = xml.find('&'); at != std::string::npos; at = xml.find('&', at + 1)) {
    if (xml.find(';', at) > at + 6) return false;
  }
  return open.empty();
}

TEST(Svg, EscapesText) {
  Svg svg(100.0, 50.0);
  svg.Text({1.0, 2.0}, "a<b & \"c\" > d\x01", {});
  const std::string text = svg.ToString();
  EXPECT_TRUE(IsWellFormed(text)) << text;
  EXPECT_THAT(text, HasSubstr("a&lt;b &amp; &quot;c&quot; &gt; d "));
}

TEST(Svg, DrawsShapes) {
  Svg svg(100.0, 50.0);
  svg.Line({0.0, 0.0}, {1.0, 1.0}, {.stroke = "#000000"});
  svg.Polyline(std::vector<Eigen::Vector2d>{{0.0, 0.0}, {2.0, 3.0}}, {.stroke = "#000000"});
  svg.Circle({5.0, 5.0}, 2.0, {.fill = "#ff0000"}, "tip <1>");
  svg.Ellipse({5.0, 5.0}, {2.0, 1.0}, 1.5707963, {.fill = "#ff0000", .opacity = 0.5});
  svg.Rect({0.0, 0.0}, {3.0, 3.0}, {.stroke = "#000000", .dash = "4 3"});
  const std::string text = svg.ToString();
  EXPECT_TRUE(IsWellFormed(text)) << text;
  EXPECT_THAT(text, HasSubstr("points=\"0.00,0.00 2.00,3.00 \""));
  EXPECT_THAT(text, HasSubstr("rotate(90.00)"));
  EXPECT_THAT(text, HasSubstr("<title>tip &lt;1&gt;</title>"));
  EXPECT_THAT(text, HasSubstr("viewBox=\"0 0 100 50\""));
}

TEST(LabelPlacer, LabelsDoNotOverlapUnlessForced) {
  LabelPlacer placer;
  const Eigen::Vector2d size(20.0, 10.0);
  std::vector<Eigen::Vector2d> placed;
  for (int i = 0; i < 12; ++i) {
    const auto at = placer.Place({0.0, 0.0}, 3.0, size, false);
    if (!at) continue;
    for (const Eigen::Vector2d& other : placed) {
      EXPECT_TRUE(std::abs(at->x() - other.x()) >= 20.0 || std::abs(at->y() - other.y()) >= 10.0);
    }
    placed.push_back(*at);
  }
  EXPECT_GE(placed.size(), 2U);
  EXPECT_LT(placed.size(), 12U);
  EXPECT_TRUE(placer.Place({0.0, 0.0}, 3.0, size, true).has_value());
}

TEST(MapPlot, DrawsEveryModeAndLabelsEveryLandmark) {
  std::mt19937_64 random(testing::TestSeed(7));
  const MapSnapshot map(
      "hall <1>", VersionNumber(3), "hash", testing::RandomContent(random, {.groups = 10}));
  Provenance provenance;
  RunRecord run;
  run.name = "run & 1";
  run.trajectory = {{map.stamp(), Se2()}, {map.stamp(), Se2(5.0, 5.0, 0.0)}};
  provenance.runs.push_back(run);
  const std::string text = PlotMap(map, provenance);
  EXPECT_TRUE(IsWellFormed(text)) << text;
  EXPECT_THAT(text, HasSubstr("hall &lt;1&gt;"));
  EXPECT_THAT(text, HasSubstr("run &amp; 1"));
  EXPECT_THAT(text, Not(HasSubstr("nan")));
  for (const LandmarkGroup& group : map.groups()) {
    EXPECT_THAT(text, ContainsRegex(">" + group.signature.text() + "( .absent.)?</text>"));
    for (const Mode& mode : group.modes) {
      EXPECT_THAT(text,
                  HasSubstr(fmt::format(
                      "<title>{} mode {}:", group.signature.text(), mode.number.value())));
    }
  }
}

TEST(MapPlot, AnEmptyMapIsAPictureToo) {
  const MapSnapshot map("empty", VersionNumber(1), "hash", MapContent());
  EXPECT_TRUE(IsWellFormed(PlotMap(map, {})));
}

}  // namespace
}  // namespace shiftmap
