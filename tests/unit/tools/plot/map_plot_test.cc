// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/map_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "tests/support/random_map.h"
#include "tests/unit/tools/plot/svg_picture.h"
#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/modes_plot.h"

namespace shiftmap {
namespace {

using testing::CountElements;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::PictureDefect;
using testing::SvgElement;
using testing::TextsOf;

MapContent Content(int groups, std::uint64_t seed = 7) {
  std::mt19937_64 random(testing::TestSeed(seed));
  return testing::RandomContent(random, {.groups = groups});
}

MapSnapshot Map(MapContent content) { return testing::MapOf("hall", 3, std::move(content)); }

RunRecord MakeRun(const std::string& name, int poses, Stamp begin, double offset_m = 0.0) {
  RunRecord run;
  run.name = name;
  run.begin = begin;
  for (int i = 0; i < poses; ++i) {
    const Se2 pose(offset_m + 10.0 * std::sin(0.01 * i), 8.0 * std::cos(0.013 * i), 0.0);
    run.trajectory.push_back({begin + FromSeconds(i), pose});
  }
  return run;
}

// Moves all landmarks.
MapContent Moved(MapContent content, const Eigen::Vector2d& by) {
  for (LandmarkGroup& group : content.groups) {
    for (Mode& mode : group.modes) mode.p_map_landmark += by;
  }
  for (Mode& mode : content.anonymous_landmarks) mode.p_map_landmark += by;
  return content;
}

MapContent WithSd(MapContent content, double sd_m) {
  for (LandmarkGroup& group : content.groups) {
    for (Mode& mode : group.modes) {
      mode.cov_p_map_landmark = Eigen::Vector2d(1.0, 0.25).asDiagonal() * sd_m * sd_m;
    }
  }
  content.anonymous_landmarks.clear();
  std::vector<Eigen::Matrix2d> diagonal(static_cast<std::size_t>(content.covariance.size()),
                                        sd_m * sd_m * Eigen::Matrix2d::Identity());
  content.covariance = JointCovariance(std::move(diagonal), {});
  return content;
}

TEST(MapPlot, HasNoDefectAtAnySize) {
  for (const int groups : {0, 1, 2, 10, 60, 300, 2000}) {
    const MapContent content = Content(groups);
    const MapSnapshot map = Map(content);
    const std::vector<RunRecord> runs = {MakeRun("run & 1", 300, map.stamp())};
    EXPECT_EQ(PictureDefect(PlotMap(map, runs, {})), "") << groups;
  }
}

TEST(MapPlot, NamesEveryLandmarkOfASmallMap) {
  const MapSnapshot map = Map(Content(10));
  const std::string svg = PlotMap(map, {}, {});
  for (const LandmarkGroup& group : map.groups()) {
    EXPECT_THAT(TextsOf(svg), HasSubstr(group.signature.text() + "\n"));
    for (const Mode& mode : group.modes) {
      EXPECT_THAT(svg,
                  HasSubstr(fmt::format(
                      "<title>{} mode {}:", group.signature.text(), mode.number.value())));
    }
  }
}

TEST(MapPlot, IsTheSamePictureWhereverTheWorldIs) {
  const MapContent here = Content(12);
  const std::string near = PlotMap(Map(here), {}, {});
  const std::string far = PlotMap(Map(Moved(here, {500000.0, -4000000.0})), {}, {});
  EXPECT_EQ(PictureDefect(far), "");
  const std::vector<SvgElement> a = testing::ParseSvg(near);
  const std::vector<SvgElement> b = testing::ParseSvg(far);
  ASSERT_EQ(a.size(), b.size());
  // Longer numbers along the y axis push the frame to the right.
  const auto left = [](const std::vector<SvgElement>& elements) {
    for (const SvgElement& element : elements) {
      if (element.name == "ellipse") return element.attributes.at("transform");
    }
    return std::string();
  };
  double x_a = 0.0;
  double x_b = 0.0;
  ASSERT_EQ(std::sscanf(left(a).c_str(), "translate(%lf", &x_a), 1);
  ASSERT_EQ(std::sscanf(left(b).c_str(), "translate(%lf", &x_b), 1);
  int compared = 0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].name, b[i].name);
    if (a[i].name != "circle") continue;
    EXPECT_NEAR(b[i].Number("cx") - a[i].Number("cx"), x_b - x_a, 0.03);
    EXPECT_NEAR(b[i].Number("cy"), a[i].Number("cy"), 0.03);
    EXPECT_EQ(b[i].Number("r"), a[i].Number("r"));
    EXPECT_EQ(a[i].attributes.count("fill-opacity"), b[i].attributes.count("fill-opacity"));
    ++compared;
  }
  EXPECT_GT(compared, 20);
}

TEST(MapPlot, NoEllipseLeavesTheFrame) {
  for (const double sd_m : {0.001, 0.05, 0.5, 5.0}) {
    const MapContent content = WithSd(Content(15), sd_m);
    const LandmarkLayer layer(content, {});
    Svg svg(2000.0, 2000.0);
    layer.Draw(1.0, &svg);
    const Eigen::Vector2d corner = layer.frame().corner();
    const Eigen::Vector2d end = corner + layer.frame().size();
    for (const SvgElement& element : testing::ParseSvg(svg.ToString())) {
      if (element.name != "ellipse") continue;
      double x = 0.0;
      double y = 0.0;
      ASSERT_EQ(
          std::sscanf(element.attributes.at("transform").c_str(), "translate(%lf %lf)", &x, &y), 2);
      EXPECT_GE(x - element.Number("rx"), corner.x()) << sd_m;
      EXPECT_LE(x + element.Number("rx"), end.x()) << sd_m;
      EXPECT_GE(y - element.Number("ry"), corner.y()) << sd_m;
      EXPECT_LE(y + element.Number("ry"), end.y()) << sd_m;
    }
  }
}

// The legend's factor is the one by which ellipses are drawn too large.
TEST(MapPlot, SmallEllipsesAreMagnifiedAsTheLegendSays) {
  for (const auto& [sd_m, magnified] : {std::pair(20.0, false), {0.005, true}}) {
    const MapContent content = WithSd(Content(15), sd_m);
    const LandmarkLayer layer(content, {});
    Svg svg(2000.0, 2000.0);
    layer.Draw(1.0, &svg);
    Legend legend;
    layer.AddTo(&legend);
    Svg column(400.0, 400.0);
    legend.Draw({0.0, 0.0}, &column);
    double told = 1.0;
    const std::string texts = TextsOf(column.ToString());
    if (const std::size_t at = texts.find("drawn "); at != std::string::npos) {
      told = std::stod(texts.substr(at + 6));
    }
    EXPECT_EQ(told > 1.0, magnified);
    const double true_px =
        MakeEllipse(content.groups[0].modes[0].cov_p_map_landmark).half_axes.x() *
        layer.frame().pixels_per_m();
    for (const SvgElement& element : testing::ParseSvg(svg.ToString())) {
      if (element.name != "ellipse") continue;
      EXPECT_NEAR(element.Number("rx"), told * true_px, 0.02);
      EXPECT_GT(element.Number("rx"), 4.0);
    }
  }
}

TEST(MapPlot, ALikelyAbsentLandmarkLooksDifferent) {
  MapContent content = WithSd(Content(1), 0.1);
  LandmarkGroup& group = content.groups[0];
  group.probabilities.setConstant(0.1 / static_cast<double>(group.modes.size()));
  group.probabilities(0) = 0.9;
  const std::string absent = PlotMap(Map(content), {}, {});
  EXPECT_THAT(TextsOf(absent), HasSubstr("absent 90 %"));
  EXPECT_THAT(absent, HasSubstr("stroke-dasharray=\"2 1.5\""));
  group.probabilities.setZero();
  group.probabilities(1) = 1.0;
  const std::string there = PlotMap(Map(content), {}, {});
  EXPECT_THAT(TextsOf(there), HasSubstr("m1 > 99 %"));
  EXPECT_THAT(TextsOf(there), Not(HasSubstr("absent 90 %")));
}

TEST(MapPlot, OpacityIsProbability) {
  MapContent content = WithSd(Content(1), 0.1);
  LandmarkGroup& group = content.groups[0];
  group.probabilities.setConstant(0.75 / static_cast<double>(group.probabilities.size() - 1));
  group.probabilities(1) = 0.25;
  EXPECT_THAT(PlotMap(Map(content), {}, {}), HasSubstr("fill-opacity=\"0.25\""));
}

TEST(MapPlot, ManyLandmarksAndRunsStaySmall) {
  const MapContent content = Content(5000);
  const MapSnapshot map = Map(content);
  std::vector<RunRecord> runs;
  for (int i = 0; i < 60; ++i)
    runs.push_back(MakeRun(fmt::format("run_{}", i), 3000, map.stamp(), i));
  const std::string svg = PlotMap(map, runs, runs);
  EXPECT_LT(svg.size(), 2'500'000U);
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_THAT(TextsOf(svg), HasSubstr("too many for ellipses and labels"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("run_59"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("54 more of this version"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("60 of earlier versions"));
}

TEST(MapPlot, ShowsTheRunsOfAllVersions) {
  const MapSnapshot map = Map(Content(3));
  const std::string svg =
      PlotMap(map, {MakeRun("new", 200, map.stamp())}, {MakeRun("old", 200, map.stamp(), 20.0)});
  EXPECT_EQ(CountElements(svg, "polyline"), 2);
}

TEST(MapPlot, HostileNamesAreText) {
  MapContent content = Content(2);
  content.groups[0].signature = Signature("\"/><script>alert(1)</script>\x1b[2J");
  std::sort(content.groups.begin(), content.groups.end(), [](const auto& a, const auto& b) {
    return a.signature < b.signature;
  });
  const MapSnapshot map = testing::MapOf("<area> & co", 1, content);
  const std::string svg = PlotMap(map, {MakeRun("</svg>", 50, map.stamp())}, {});
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_EQ(CountElements(svg, "script"), 0);
  EXPECT_EQ(CountElements(svg, "svg"), 1);
}

TEST(MapPlot, FarCoordinatesAreAPictureToo) {
  MapContent content = Content(3);
  content.groups[0].modes[0].p_map_landmark = {1e9, -1e9};
  EXPECT_EQ(PictureDefect(PlotMap(Map(content), {}, {})), "");
}

TEST(ModesPlot, HasNoDefectForAnyLandmark) {
  const MapSnapshot map = Map(Content(12, 5));
  for (const LandmarkGroup& group : map.groups()) {
    const std::string svg = PlotModes(map, group);
    EXPECT_EQ(PictureDefect(svg), "") << group.signature.text();
    for (const Mode& mode : group.modes) {
      EXPECT_THAT(TextsOf(svg), HasSubstr(fmt::format("mode {}: ", mode.number.value())));
    }
  }
}

TEST(ModesPlot, HasARowOfRatesPerState) {
  MapContent content = Content(1);
  LandmarkGroup& group = content.groups[0];
  group.modes.resize(1);
  group.probabilities = Eigen::Vector2d(0.5, 0.5);
  Eigen::Matrix2d rates;
  rates << -2e-5, 2e-5, 3e-6, -3e-6;
  group.chain = *ModeChain::FromRates(rates);
  const std::string texts = TextsOf(PlotModes(Map(content), group));
  EXPECT_THAT(texts, HasSubstr("2e-05"));
  EXPECT_THAT(texts, HasSubstr("left once in 13.9 h"));
  EXPECT_THAT(texts, HasSubstr("left once in 3.86 days"));
}

TEST(ModesPlot, ManyModesAreAPictureToo) {
  std::mt19937_64 random(testing::TestSeed(4));
  MapContent content;
  content.groups.push_back(testing::RandomGroup(random, "L", 40));
  EXPECT_EQ(PictureDefect(PlotModes(Map(content), content.groups[0])), "");
}

}  // namespace
}  // namespace shiftmap
