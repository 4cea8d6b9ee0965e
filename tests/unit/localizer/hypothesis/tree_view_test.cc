// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/tree_view.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/hypothesis/leaf_reduction.h"
#include "tests/unit/localizer/simulated_run.h"

namespace shiftmap {
namespace {

using ::testing::ElementsAre;

// Groups 3, 5 and 8 with two modes each.
Leaf MakeLeaf(double weight, const std::vector<int>& resolved) {
  Leaf leaf{KnownMapFilter(PoseWithCovariance{Se2(), Eigen::Matrix3d::Identity()}, {}),
            std::log(weight),
            {},
            0};
  const int groups[] = {3, 5, 8};
  for (std::size_t i = 0; i < resolved.size(); ++i) {
    PlaceBelief belief;
    belief.group = groups[i];
    belief.resolved = resolved[i];
    belief.log_p.resize(3, std::log(1.0 / 3.0));
    belief.log_missed.resize(3, 0.0);
    leaf.beliefs.push_back(belief);
  }
  return leaf;
}

TEST(TreeView, InnerScoresAreSumsOverTheirLeaves) {
  LeafSet<Leaf> leaves;
  leaves.Add(MakeLeaf(0.40, {2, 1, 1}));
  leaves.Add(MakeLeaf(0.35, {1, 1, 1}));
  leaves.Add(MakeLeaf(0.25, {1, 1, 2}));
  const TreeView tree(leaves);
  EXPECT_THAT(tree.groups(), ElementsAre(3, 8));  // All agree about 5.
  const TreeView::Node& root = tree.nodes()[0];
  EXPECT_NEAR(root.log_probability, 0.0, 1e-12);
  ASSERT_EQ(root.children.size(), 2u);
  const TreeView::Node& second = tree.nodes()[root.children[0]];
  const TreeView::Node& first = tree.nodes()[root.children[1]];
  EXPECT_EQ(second.state, 2);
  EXPECT_NEAR(std::exp(second.log_probability), 0.4, 1e-12);
  EXPECT_EQ(first.state, 1);
  EXPECT_NEAR(std::exp(first.log_probability), 0.6, 1e-12);
  EXPECT_EQ(first.children.size(), 2u);
}

TEST(TreeView, TheGlobalHypothesisIsTheBestChildOfTheBestChild) {
  LeafSet<Leaf> leaves;
  leaves.Add(MakeLeaf(0.40, {2, 1, 1}));
  leaves.Add(MakeLeaf(0.35, {1, 1, 1}));
  leaves.Add(MakeLeaf(0.25, {1, 1, 2}));
  EXPECT_EQ(TreeView(leaves).GlobalHypothesis(), 1);  // Though leaf 0 is heavier.
}

TEST(TreeView, OfTheHeaviestLeavesAlone) {
  LeafSet<Leaf> leaves;
  leaves.Add(MakeLeaf(0.40, {2, 1, 1}));
  leaves.Add(MakeLeaf(0.35, {1, 1, 1}));
  leaves.Add(MakeLeaf(0.25, {1, 1, 2}));
  const TreeView tree(leaves, 2);
  EXPECT_THAT(tree.groups(), ElementsAre(3));
  EXPECT_NEAR(std::exp(tree.nodes()[0].log_probability), 0.75, 1e-12);
}

TEST(TreeView, LeavesOfOneAssignmentShareANode) {
  LeafSet<Leaf> leaves;
  leaves.Add(MakeLeaf(0.5, {2, 1, 1}));
  leaves.Add(MakeLeaf(0.3, {1, 1, 1}));
  leaves.Add(MakeLeaf(0.2, {2, 1, 1}));
  const TreeView tree(leaves);
  ASSERT_EQ(tree.nodes().size(), 3u);
  EXPECT_NEAR(std::exp(tree.nodes()[1].log_probability), 0.7, 1e-12);
  EXPECT_EQ(tree.nodes()[1].leaf, 0);
}

TEST(TreeView, OfOneLeafIsTheRoot) {
  LeafSet<Leaf> leaves;
  leaves.Add(MakeLeaf(1.0, {2, GroupBelief::kUnresolved, 1}));
  const TreeView tree(leaves);
  EXPECT_EQ(tree.nodes().size(), 1u);
  EXPECT_EQ(tree.GlobalHypothesis(), 0);
}

// The probabilities of a level, those of unresolved nodes by their leaf, are the bank's.
TEST(TreeView, AgreesWithTheMarginalsOfABank) {
  MapContent content = MakeTwoModeMap(8, 8.0, 9);
  content.calibration.sensor.max_bearing_rad = 3.1;
  HypothesisOptions options;
  options.alpha = 1e-9;
  const PoseWithCovariance start{Se2(), Eigen::Vector3d(0.5, 0.5, 0.01).asDiagonal()};
  HypothesisBank bank(Snapshot(content), options, start, StampFromSeconds(1000.0));
  Scan scan;
  scan.stamp = StampFromSeconds(1000.3);
  for (const LandmarkGroup& group : content.groups) {
    const Eigen::Vector2d q = group.modes[1].p_map_landmark + Eigen::Vector2d(0.4, 0.3);
    Observation observation;
    observation.signature = group.signature;
    observation.z = {q.norm(), std::atan2(q.y(), q.x())};
    scan.observations.push_back(observation);
    bank.Correct(scan);
    scan.observations.clear();
    scan.stamp += FromSeconds(0.3);
  }
  const LeafSet<Leaf>& leaves = bank.leaves();
  const TreeView tree(leaves);
  ASSERT_GT(leaves.size(), 1u);
  ASSERT_FALSE(tree.groups().empty());
  for (const int group : tree.groups()) {
    std::size_t belief = 0;
    while (leaves.front().beliefs[belief].group != group) ++belief;
    const StateValues marginal = MarginalLogProbability(leaves, belief);
    double resolved_2 = kLogZero;
    for (const TreeView::Node& node : tree.nodes()) {
      if (node.group == group && node.state == 2)
        resolved_2 = LogAdd(resolved_2, node.log_probability);
    }
    for (const Leaf* leaf : leaves.all()) {
      if (leaf->beliefs[belief].resolved != GroupBelief::kUnresolved) continue;
      resolved_2 = LogAdd(resolved_2, leaf->log_weight + leaf->beliefs[belief].log_p[2]);
    }
    EXPECT_NEAR(resolved_2, marginal[2], 1e-9);
  }
}

}  // namespace
}  // namespace shiftmap
