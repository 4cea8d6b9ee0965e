// SPDX-License-Identifier: Apache-2.0
//
// Pictures with an axis of time or of rates.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <random>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/unit/tools/plot/svg_picture.h"
#include "tools/plot/chart_frame.h"
#include "tools/plot/consistency_plot.h"
#include "tools/plot/history_plot.h"
#include "tools/plot/rates_plot.h"
#include "tools/plot/trajectory_plot.h"

namespace shiftmap {
namespace {

using ::testing::HasSubstr;
using testing::IsOk;
using testing::PictureDefect;
using testing::StatusIs;
using testing::TextsOf;

// 2026-01-09 06:00:00 UTC.
const Stamp kMorning = StampFromSeconds(1767938400.0);

MapSnapshot Map(int groups) {
  std::mt19937_64 random(testing::TestSeed(7));
  return MapSnapshot(
      "hall", VersionNumber(3), "hash", testing::RandomContent(random, {.groups = groups}));
}

// Scans of a filter whose errors are drawn from `scale` times its covariance.
std::vector<ScanConsistency> Scans(int count, double scale) {
  std::mt19937_64 random(testing::TestSeed(5));
  std::chi_squared_distribution<double> nis(4.0);
  std::vector<ScanConsistency> scans;
  for (int i = 0; i < count; ++i) {
    ScanConsistency scan;
    scan.stamp = kMorning + FromSeconds(0.2 * i);
    scan.pose.cov_T_map_vehicle = 0.01 * Eigen::Matrix3d::Identity();
    scan.pose.T_map_vehicle = Se2(0.1 * std::sqrt(3.0), 0.0, 0.0);
    scan.nis = scale * nis(random);
    scan.dof = 4;
    scans.push_back(scan);
  }
  return scans;
}

std::vector<StampedPose> Truth(int count, const Se2& pose = Se2()) {
  std::vector<StampedPose> truth;
  for (int i = 0; i < count; ++i) truth.push_back({kMorning + FromSeconds(0.2 * i), pose});
  return truth;
}

// A landmark seen at mode 1, then at mode 2, every hour.
LandmarkHistory History(int visits) {
  LandmarkHistory history;
  history.area = "hall";
  history.signature = Signature("L<07>");
  history.version = VersionNumber(2);
  history.stamp = kMorning + std::chrono::hours(visits);
  history.probabilities = {{kAbsent, 0.05}, {ModeNumber(1), 0.05}, {ModeNumber(2), 0.9}};
  for (int m = 1; m <= 2; ++m) {
    ModeHistory mode;
    mode.number = ModeNumber(m);
    history.modes.push_back(mode);
  }
  for (int i = 0; i < visits; ++i) {
    HistoryVisit visit;
    visit.begin = kMorning + std::chrono::hours(i);
    visit.end = visit.begin + std::chrono::minutes(1);
    visit.likely_mode = ModeNumber(2 * i < visits ? 1 : 2);
    visit.log_odds = i;
    if (i % 5 == 4) visit.set_aside = SetAside::kExcluded;
    history.visits.push_back(visit);
  }
  std::vector<VisitSpan> spans;
  for (const HistoryVisit& visit : history.visits) spans.push_back({visit.begin, visit.end});
  for (const Stamp at : HistoryTimes(spans, history.stamp, history.stamp)) {
    const double p = at < kMorning + std::chrono::hours(visits / 2) ? 0.9 : 0.1;
    history.track.push_back({at, {{kAbsent, 0.05}, {ModeNumber(1), p}, {ModeNumber(2), 0.95 - p}}});
  }
  return history;
}

std::vector<VersionSummary> Versions(int count) {
  std::vector<VersionSummary> versions(static_cast<std::size_t>(count));
  for (int i = 0; i < count; ++i) {
    versions[static_cast<std::size_t>(i)].version = VersionNumber(i + 1);
    versions[static_cast<std::size_t>(i)].stamp = kMorning + std::chrono::minutes(20 * i);
  }
  return versions;
}

// Steps in seconds are not exact, and a stamp just before a second would be shown as the one
// before.
TEST(EvenTimes, EndWhereTheyAreToEnd) {
  const Stamp from = kMorning + Duration(123'456'789);
  for (int minutes = 1; minutes < 200; ++minutes) {
    const Stamp to = kMorning + std::chrono::minutes(minutes);
    const std::vector<Stamp> times = EvenTimes(from, to, 7);
    ASSERT_EQ(times.size(), 8U);
    EXPECT_EQ(times.front(), from);
    EXPECT_EQ(times.back(), to);
    EXPECT_TRUE(std::is_sorted(times.begin(), times.end()));
  }
  EXPECT_EQ(EvenTimes(kMorning, kMorning, 5), std::vector<Stamp>{kMorning});
}

TEST(HistoryPlot, HasARowPerModeAndAMarkPerVersion) {
  const std::string svg = PlotHistory(History(12), Versions(3));
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_THAT(TextsOf(svg), HasSubstr("mode 2: 85 % at the end"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("v3"));
  EXPECT_THAT(TextsOf(svg), HasSubstr("2026-01-09"));
  EXPECT_EQ(testing::CountElements(svg, "polygon"), 3);
}

TEST(HistoryPlot, ProbabilitiesAreStackedToTheWhole) {
  const std::string svg = PlotHistory(History(12), {});
  double lowest = 0.0;
  double highest = 1e9;
  for (const testing::SvgElement& element : testing::ParseSvg(svg)) {
    if (element.name != "polygon") continue;
    std::istringstream points(element.attributes.at("points"));
    double x = 0.0;
    double y = 0.0;
    char comma = 0;
    while (points >> x >> comma >> y) {
      lowest = std::max(lowest, y);
      highest = std::min(highest, y);
    }
  }
  EXPECT_NEAR(lowest - highest, 260.0, 0.1);
}

TEST(HistoryPlot, ManyVisitsVersionsAndNoneAreAPictureToo) {
  const LandmarkHistory many = History(20000);
  const std::string svg = PlotHistory(many, Versions(500));
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_LT(svg.size(), 500'000U);
  EXPECT_EQ(PictureDefect(PlotHistory(History(0), {})), "");
}

TEST(RatesPlot, IsSortedWithRealValuesOnTheAxis) {
  const MapSnapshot map = Map(2);
  const MoveRates rates = {
      {Signature("slow"), {1.1e-6, 2e-7, 4e-6, 3}},
      {Signature("fast"), {1e-3, 2e-4, 4e-3, 12345}},
      {Signature("<never>"), {0.0, 0.0, 0.0, 0}},
  };
  const std::string svg = PlotRates(map, rates);
  EXPECT_EQ(PictureDefect(svg), "");
  const std::string texts = TextsOf(svg);
  EXPECT_LT(texts.find("fast\n"), texts.find("slow\n"));
  EXPECT_THAT(texts, HasSubstr("12345\n"));
  EXPECT_THAT(texts, HasSubstr("1e-3\n"));
  EXPECT_THAT(texts, HasSubstr("move rate [1/s]"));
  EXPECT_THAT(texts, HasSubstr("1 day\n"));
}

TEST(RatesPlot, OfThousandsHasThinRows) {
  MoveRates rates;
  for (int i = 0; i < 5000; ++i) {
    const double rate = 1e-7 * (1.0 + i);
    rates[Signature(fmt::format("{}", i))] = {rate, 0.5 * rate, 2.0 * rate, i};
  }
  const std::string svg = PlotRates(Map(1), rates);
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_LT(svg.size(), 1'000'000U);
  EXPECT_EQ(PictureDefect(PlotRates(Map(0), {})), "");
}

// Of two observations of a scan one gated; a scan may have no pose, and a pose no observations.
TEST(ConsistencyPlot, ReadsScansFromARecording) {
  ShiftRecording recording;
  live::PoseEvent pose;
  pose.stamp = kMorning;
  pose.pose.T_map_vehicle = Se2(1.0, 2.0, 3.0);
  recording.poses = {pose};
  RecordedInnovation gated;
  gated.mode = ModeNumber(1);
  gated.nis = 3.5;
  recording.innovations = {{kMorning, 1.0, {gated, RecordedInnovation()}},
                           {kMorning + FromSeconds(0.1), 1.0, {gated, gated}}};
  const std::vector<ScanConsistency> scans = ScansOf(recording);
  ASSERT_EQ(scans.size(), 2U);
  EXPECT_EQ(scans[0].pose.T_map_vehicle.x(), 1.0);
  EXPECT_EQ(scans[0].nis, 3.5);
  EXPECT_EQ(scans[0].dof, 2);
  EXPECT_EQ(scans[1].nis, 7.0);
  EXPECT_EQ(scans[1].dof, 4);
}

TEST(ConsistencyPlot, TellsAConsistentFilterFromASureOne) {
  const std::string good = PlotConsistency("run", Scans(3000, 1.0), std::nullopt);
  EXPECT_EQ(PictureDefect(good), "");
  EXPECT_THAT(TextsOf(good), ::testing::ContainsRegex("mean (0.9|1.0)[0-9]+ over 12000"));
  EXPECT_THAT(TextsOf(good), ::testing::ContainsRegex("[45]\\.[0-9] % of the scans"));
  const std::string sure = PlotConsistency("run", Scans(3000, 3.0), std::nullopt);
  EXPECT_THAT(TextsOf(sure), ::testing::ContainsRegex("mean (2.9|3.0)[0-9]+ over 12000"));
}

TEST(ConsistencyPlot, HasTheErrorOfThePoseIfThereIsATruth) {
  const std::string svg = PlotConsistency("run", Scans(200, 1.0), Truth(200));
  EXPECT_EQ(PictureDefect(svg), "");
  EXPECT_THAT(TextsOf(svg), HasSubstr("mean 3.00, 3 expected"));
  EXPECT_THAT(TextsOf(PlotConsistency("run", Scans(9, 1.0), std::vector<StampedPose>())),
              HasSubstr("the truth covers no scan"));
}

TEST(ConsistencyPlot, FewScansAndScansOfNothingAreAPictureToo) {
  EXPECT_EQ(PictureDefect(PlotConsistency("run", Scans(1, 1.0), std::nullopt)), "");
  std::vector<ScanConsistency> blind = Scans(20, 1.0);
  for (ScanConsistency& scan : blind) scan.dof = 0;
  EXPECT_EQ(PictureDefect(PlotConsistency("run", blind, std::nullopt)), "");
}

TEST(TrajectoryPlot, HasTheErrorAgainstTheTruth) {
  const NamedTrajectory estimate{"est", Truth(100, Se2(0.3, 0.4, 0.0))};
  const NamedTrajectory truth{"truth", Truth(100)};
  const StatusOr<std::string> svg = PlotTrajectories(Map(5), {estimate, truth}, truth);
  ASSERT_THAT(svg, IsOk());
  EXPECT_EQ(PictureDefect(*svg), "");
  const std::string texts = TextsOf(*svg);
  EXPECT_THAT(texts, HasSubstr("rmse 0.500 m"));
  EXPECT_THAT(texts, HasSubstr("rmse 0.000 m"));
  EXPECT_THAT(texts, HasSubstr("position error [m]"));
  const StatusOr<std::string> alone = PlotTrajectories(Map(5), {estimate}, std::nullopt);
  ASSERT_THAT(alone, IsOk());
  EXPECT_EQ(PictureDefect(*alone), "");
}

TEST(TrajectoryPlot, RefusesATruthOfAnotherTime) {
  NamedTrajectory truth{"truth", Truth(100)};
  for (StampedPose& pose : truth.poses) pose.stamp += std::chrono::hours(1);
  EXPECT_THAT(PlotTrajectories(Map(1), {{"est", Truth(100)}}, truth),
              StatusIs(StatusCode::kInvalidArgument, "trajectory 'est'"));
}

TEST(Condensed, KeepsWhatAColumnOfPixelsShows) {
  std::vector<Eigen::Vector2d> points;
  for (int i = 0; i < 10000; ++i) points.emplace_back(0.01 * i, i % 97 == 0 ? 50.0 : i % 7);
  const std::vector<Eigen::Vector2d> kept = Condensed(points);
  EXPECT_LE(kept.size(), 4U * 100U);
  EXPECT_EQ(kept.front(), points.front());
  EXPECT_EQ(kept.back(), points.back());
  int peaks = 0;
  for (const Eigen::Vector2d& p : kept) peaks += p.y() == 50.0 ? 1 : 0;
  EXPECT_GE(peaks, 100);
}

}  // namespace
}  // namespace shiftmap
