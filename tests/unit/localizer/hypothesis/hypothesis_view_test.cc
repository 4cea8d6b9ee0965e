// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/hypothesis_view.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

// A landmark at one of two places, seen halfway between them from a pose that is hardly known.
MapContent Ambiguous() {
  MapContent content = MakeTwoModeMap(1, 10.0, 1);
  content.groups[0].modes[0].p_map_landmark = {4.0, 0.0};
  content.groups[0].modes[1].p_map_landmark = {5.0, 0.0};
  return content;
}

HypothesisView ViewAfterOneScan(const MapContent& content, double range_m, double sd_m) {
  HypothesisOptions options;
  options.alpha = 0.02;
  const MapSnapshot snapshot = Snapshot(content);
  const PoseWithCovariance start{Se2(),
                                 Eigen::Vector3d(sd_m * sd_m, sd_m * sd_m, 1e-4).asDiagonal()};
  HypothesisBank bank(snapshot, options, start, StampFromSeconds(1000.0));
  Scan scan;
  scan.stamp = StampFromSeconds(1000.0);
  Observation observation;
  observation.signature = content.groups[0].signature;
  observation.z = {range_m, 0.0};
  scan.observations.push_back(observation);
  bank.Correct(scan);
  return ViewHypotheses(bank, snapshot);
}

TEST(HypothesisView, NamesWhatLeavesDisagreeAbout) {
  const MapContent content = Ambiguous();
  const HypothesisView view = ViewAfterOneScan(content, 4.5, 1.0);
  ASSERT_GE(view.nodes.size(), 3u);
  EXPECT_EQ(view.leaves + 1, static_cast<std::int64_t>(view.nodes.size()));
  EXPECT_EQ(view.nodes[0].parent, -1);
  EXPECT_TRUE(view.nodes[0].signature.anonymous());
  double sum = 0.0;
  for (std::size_t i = 1; i < view.nodes.size(); ++i) {
    const HypothesisView::Node& node = view.nodes[i];
    EXPECT_EQ(node.parent, 0);
    EXPECT_EQ(node.signature, content.groups[0].signature);
    ASSERT_TRUE(node.T_map_vehicle);
    // Half a metre before or behind where it was thought to be.
    sum += node.probability;
    if (!node.mode) continue;
    EXPECT_NEAR(std::abs(node.T_map_vehicle->x()), 0.5, 0.1);
  }
  EXPECT_NEAR(sum, 1.0, 1e-9);
  EXPECT_NEAR(view.nodes[0].probability, 1.0, 1e-9);
  EXPECT_GT(view.global_hypothesis, 0);
}

TEST(HypothesisView, SaysWhatVisitsSay) {
  const MapContent content = Ambiguous();
  const HypothesisView view = ViewAfterOneScan(content, 5.0, 0.02);
  ASSERT_EQ(view.visits.size(), 1u);
  const HypothesisView::VisitView& visit = view.visits[0];
  EXPECT_EQ(visit.signature, content.groups[0].signature);
  EXPECT_EQ(visit.observations, 1);
  EXPECT_EQ(visit.decided, ModeNumber(2));
  ASSERT_EQ(visit.probabilities.size(), 3u);
  EXPECT_EQ(visit.probabilities[0].mode, kAbsent);
  EXPECT_GT(visit.probabilities[2].probability, 0.98);
}

}  // namespace
}  // namespace shiftmap
