// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_utias_pictures.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace shiftmap {
namespace {

using ::testing::ElementsAre;

std::vector<std::string> Names(const Chart& chart) {
  std::vector<std::string> names;
  for (const ChartSeries& series : chart.series) names.push_back(series.name);
  return names;
}

class IjrrUtiasPicturesTest : public ::testing::Test {
 protected:
  IjrrUtiasPicturesTest() {
    const Signature a("a");
    const Signature b("b");
    data_.dataset = 1;
    data_.robot = 2;
    data_.signatures = {a, b};
    data_.landmarks = {{a, {1.0, 0.0}}, {b, {0.0, 1.0}}};
    data_.moved = {b};
    for (int second = 0; second <= 3; ++second) {
      data_.truth.push_back({StampFromSeconds(second), Se2(second, 0.0, 0.0)});
    }
    data_.frames.frames.resize(2);
    data_.frames.frames.back().stamp = StampFromSeconds(2);
  }

  static IjrrUtiasRow Row(const std::string& method, std::vector<Eigen::Vector2d> modes_of_b) {
    IjrrUtiasRow row;
    row.method = method;
    row.delta_m = 0.5;
    row.estimate.poses = {Se2(0.0, 0.1, 0.0), Se2(2.0, 0.1, 0.0)};
    row.estimate.modes = {{{1.0, 0.0}}, std::move(modes_of_b)};
    return row;
  }

  UtiasCase data_;
};

TEST_F(IjrrUtiasPicturesTest, PathsHaveTheTruthUpToTheLastFrameAndMethodsThatDidNotFail) {
  const IjrrUtiasRow ours = Row("ours", {{0.5, 1.0}});
  IjrrUtiasRow failed = Row("mcts", {});
  failed.estimate = UtiasEstimate();
  const Chart chart = DrawPaths(data_, {&failed, &ours});
  EXPECT_THAT(Names(chart), ElementsAre("truth", "ours", "landmarks", "displaced in the map"));
  EXPECT_THAT(chart.series[0].points,
              ElementsAre(Eigen::Vector2d(0, 0), Eigen::Vector2d(1, 0), Eigen::Vector2d(2, 0)));
  EXPECT_THAT(chart.series[1].points,
              ElementsAre(Eigen::Vector2d(0.0, 0.1), Eigen::Vector2d(2.0, 0.1)));
  EXPECT_THAT(chart.series[3].points, ElementsAre(Eigen::Vector2d(0.5, 1.0)));
  EXPECT_TRUE(chart.equal_axes);
}

TEST_F(IjrrUtiasPicturesTest, CreatedModesAreThoseThatTheMapDoesNotHave) {
  const IjrrUtiasRow ours = Row("ours", {{0.5, 1.0}, {0.1, 1.1}});
  const IjrrUtiasRow em = Row("em", {{0.5, 1.0}});
  const Chart chart = DrawCreatedModes(data_, {&ours, &em});
  EXPECT_THAT(
      Names(chart),
      ElementsAre("truth", "landmarks", "displaced in the map", "em", "ours", "modes of ours"));
  EXPECT_THAT(chart.series.back().points, ElementsAre(Eigen::Vector2d(0.1, 1.1)));
}

}  // namespace
}  // namespace shiftmap
