// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/change_plot.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/support/random_map.h"
#include "tests/unit/tools/plot/svg_picture.h"
#include "tools/plot/map_changes.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;
using testing::PictureDefect;
using testing::TextsOf;

// Landmarks with two modes each, 1 cm accurate, at their first one.
MapContent Before() {
  MapContent content;
  for (int i = 0; i < 8; ++i) {
    LandmarkGroup group;
    group.signature = Signature(fmt::format("L{}", i));
    for (int m = 1; m <= 2; ++m) {
      group.modes.push_back({ModeNumber(m),
                             Eigen::Vector2d(3.0 * i, 10.0 * m),
                             1e-4 * Eigen::Matrix2d::Identity(),
                             Stamp()});
    }
    group.chain = ModeChain::Uniform(2, 1e-5);
    group.probabilities = Eigen::Vector3d(0.02, 0.95, 0.03);
    content.groups.push_back(group);
  }
  return content;
}

// One change of each kind; L7 as before.
MapContent After() {
  MapContent content = Before();
  std::vector<LandmarkGroup>& groups = content.groups;
  groups[0].probabilities = Eigen::Vector3d(0.02, 0.03, 0.95);
  groups[1].probabilities = Eigen::Vector3d(0.9, 0.05, 0.05);
  groups[2].modes[1].p_map_landmark.x() += 0.2;
  groups[2].modes[0].p_map_landmark.x() += 0.001;
  Mode third = groups[3].modes[1];
  third.number = ModeNumber(3);
  third.p_map_landmark.x() += 1.0;
  groups[3].modes.push_back(third);
  groups[3].chain = ModeChain::Uniform(3, 1e-5);
  groups[3].probabilities = Eigen::Vector4d(0.02, 0.95, 0.02, 0.01);
  groups[4].modes.pop_back();
  groups[4].merged.push_back({ModeNumber(2), ModeNumber(1)});
  groups[4].chain = ModeChain::Uniform(1, 1e-5);
  groups[4].probabilities = Eigen::Vector2d(0.02, 0.98);
  groups[5].probabilities = Eigen::Vector3d(0.02, 0.6, 0.38);
  groups[6].signature = Signature("L9");
  std::sort(groups.begin(), groups.end(), [](const auto& a, const auto& b) {
    return a.signature < b.signature;
  });
  return content;
}

int CountOf(const MapChanges& changes, ChangeKind kind) {
  return changes.counts[static_cast<std::size_t>(kind)];
}

MapSnapshot Map(const MapContent& content, int version) {
  return testing::MapOf("hall", version, content);
}

TEST(MapChanges, AreFoundOncePerKind) {
  const MapChanges changes = FindChanges(Before(), After());
  EXPECT_EQ(CountOf(changes, ChangeKind::kStandsElsewhere), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kLeft), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kCameBack), 0);
  EXPECT_EQ(CountOf(changes, ChangeKind::kNewLandmark), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kGoneLandmark), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kNewMode), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kGoneMode), 0);
  EXPECT_EQ(CountOf(changes, ChangeKind::kMergedMode), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kMovedEstimate), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kProbability), 1);
  EXPECT_EQ(changes.small_moves, 1);
  EXPECT_EQ(changes.changes.front().signature, Signature("L0"));
  EXPECT_EQ(changes.changes.front().detail, "m1 to m2, 95 %");
}

// A landmark that stands at a mode that is new has one label.
TEST(MapChanges, AMoveToANewModeSaysSo) {
  MapContent after = After();
  for (LandmarkGroup& group : after.groups) {
    if (group.signature == Signature("L3")) {
      group.probabilities = Eigen::Vector4d(0.02, 0.02, 0.01, 0.95);
    }
  }
  std::vector<std::string> details;
  for (const MapChange& change : FindChanges(Before(), after).changes) {
    if (change.signature == Signature("L3")) details.push_back(change.detail);
  }
  EXPECT_EQ(details, (std::vector<std::string>{"m1 to new m3, 95 %", ""}));
}

TEST(MapChanges, WhatLeftComesBackTheOtherWay) {
  const MapChanges changes = FindChanges(After(), Before());
  EXPECT_EQ(CountOf(changes, ChangeKind::kCameBack), 1);
  EXPECT_EQ(CountOf(changes, ChangeKind::kLeft), 0);
  EXPECT_EQ(CountOf(changes, ChangeKind::kGoneMode), 1);
}

TEST(DiffPlot, ShowsEveryChangeAndNothingElse) {
  const std::string svg = PlotDiff({Map(Before(), 1)}, Map(After(), 2));
  EXPECT_EQ(PictureDefect(svg), "");
  const std::string texts = TextsOf(svg);
  for (const char* signature : {"L0", "L1", "L2", "L3", "L4", "L5", "L6", "L9"}) {
    EXPECT_THAT(texts, HasSubstr(std::string(signature) + "\n"));
  }
  EXPECT_THAT(texts, Not(HasSubstr("L7\n")));
  EXPECT_THAT(texts, HasSubstr("version 1 to 2"));
  EXPECT_THAT(texts, HasSubstr("m1 95 % to 60 %"));
}

TEST(DiffPlot, OfEqualMapsShowsNoChange) {
  const std::string texts = TextsOf(PlotDiff({Map(Before(), 1)}, Map(Before(), 2)));
  EXPECT_THAT(texts, HasSubstr("none that a picture shows"));
}

TEST(DiffPlot, SaysWhatIsTakenOut) {
  EarlierMap from{Map(Before(), 1)};
  from.renamed = {{Signature("L<5>"), Signature("gate")}, {Signature("L8"), Signature("door")}};
  from.moved = Se2(1.25, -0.5, 0.1);
  const std::string svg = PlotDiff(from, Map(Before(), 2));
  EXPECT_EQ(PictureDefect(svg), "");
  const std::string texts = TextsOf(svg);
  EXPECT_THAT(texts, HasSubstr("Renamed: L<5> to gate, and 1 more"));
  EXPECT_THAT(texts, HasSubstr("turned by 5.73°"));
  EXPECT_EQ(FrameText(Se2(1.25, -0.5, 0.0)), "moved by (1.25, -0.50) m");
}

TEST(DiffPlot, OfRandomMapsHasNoDefect) {
  std::mt19937_64 random(testing::TestSeed(3));
  for (const int groups : {1, 20, 400}) {
    const MapContent a = testing::RandomContent(random, {.groups = groups});
    const MapContent b = testing::RandomContent(random, {.groups = groups});
    EXPECT_EQ(PictureDefect(PlotDiff({Map(a, 1)}, Map(b, 2))), "") << groups;
  }
}

TEST(NightPlot, ListsRunsThatAreMappedWaitOrAreHeld) {
  Night night{
      .parent = EarlierMap{Map(Before(), 1)}, .mapped = {}, .waiting = {}, .exclusions = {}};
  RunRecord run;
  run.name = "run_mapped";
  run.trajectory = {{Stamp(), Se2()}, {Stamp(), Se2(5.0, 5.0, 0.0)}};
  night.mapped.push_back(run);
  for (int i = 0; i < 12; ++i) night.waiting.push_back({fmt::format("run_{}", i), "", Stamp()});
  night.exclusions.push_back({"", "vehicle-<3>", Stamp(), "slipping wheels", true});
  night.exclusions.push_back({std::string(64, 'a'), "", Stamp(), "a test drive", false});
  const std::string svg = PlotNight(Map(After(), 2), night);
  EXPECT_EQ(PictureDefect(svg), "");
  const std::string texts = TextsOf(svg);
  EXPECT_THAT(texts, HasSubstr("run_mapped"));
  EXPECT_THAT(texts, HasSubstr("Waiting for another build: 12"));
  EXPECT_THAT(texts, HasSubstr("and 2 more"));
  EXPECT_THAT(texts, HasSubstr("Held: 1\n"));
  EXPECT_THAT(texts, HasSubstr("vehicle vehicle-<3>: slipping"));
  EXPECT_THAT(texts, HasSubstr("Excluded: 1\n"));
}

TEST(NightPlot, OfTheFirstVersionAllIsNew) {
  const std::string svg = PlotNight(Map(Before(), 1), {});
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_THAT(TextsOf(svg), HasSubstr("no version before"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("new landmark: 8"));
}

}  // namespace
}  // namespace shiftmap
