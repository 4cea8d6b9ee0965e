// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/search_tree.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace shiftmap {
namespace {

TEST(NormalizedValue, IsTheShareOfTheRange) {
  EXPECT_DOUBLE_EQ(NormalizedValue(-30.0, {-50.0, -10.0}), 0.5);
  EXPECT_DOUBLE_EQ(NormalizedValue(-50.0, {-50.0, -10.0}), 0.0);
  EXPECT_DOUBLE_EQ(NormalizedValue(-10.0, {-50.0, -10.0}), 1.0);
  EXPECT_DOUBLE_EQ(NormalizedValue(-12.5, {-20.0, -10.0}), 0.75);
}

TEST(NormalizedValue, OfATreeWithOneValueIsZero) {
  EXPECT_EQ(NormalizedValue(-7.0, {-7.0, -7.0}), 0.0);
}

// By hand: Q̄ + C √(ln n / n_i).
TEST(UctScore, IsThatOfTheFormula) {
  EXPECT_NEAR(UctScore(0.5, 1.0, 10, 4), 0.5 + 0.758713, 1e-6);
  EXPECT_NEAR(UctScore(0.25, 1.4142135623730951, 100, 25), 0.25 + 0.606971, 1e-6);
  EXPECT_DOUBLE_EQ(UctScore(0.3, 2.0, 1, 1), 0.3);
}

// Root with two sequences through state 0 (-2, -6) and one through state 2 (-3).
SearchTree SmallTree() {
  SearchTree tree(3);
  const int first = tree.Expand(SearchTree::kRoot, 0);
  const int second = tree.Expand(SearchTree::kRoot, 2);
  for (const double value : {-2.0, -6.0}) {
    tree.Record(SearchTree::kRoot, value);
    tree.Record(first, value);
  }
  tree.Record(SearchTree::kRoot, -3.0);
  tree.Record(second, -3.0);
  return tree;
}

TEST(SearchTree, KeepsMeansAndCounts) {
  const SearchTree tree = SmallTree();
  EXPECT_EQ(tree.size(), 3);
  EXPECT_EQ(tree.Visits(SearchTree::kRoot), 3);
  EXPECT_DOUBLE_EQ(tree.Value(SearchTree::kRoot), -11.0 / 3.0);
  EXPECT_DOUBLE_EQ(tree.Value(tree.Child(SearchTree::kRoot, 0)), -4.0);
  EXPECT_EQ(tree.UnvisitedChildren(SearchTree::kRoot), std::vector<int>{1});
  EXPECT_EQ(tree.Child(SearchTree::kRoot, 1), SearchTree::kNoNode);
  const ValueRange range = tree.Range();
  EXPECT_DOUBLE_EQ(range.min, -4.0);
  EXPECT_DOUBLE_EQ(range.max, -3.0);
}

// Q̄ = (0, 1), n = 3, n_i = (2, 1): the scores are C √(ln 3 / 2) and 1 + C √(ln 3), so the child
// that is better and rarer wins whatever C is.
TEST(SearchTree, GoesToTheBetterAndRarerChild) {
  const SearchTree tree = SmallTree();
  for (const double exploration : {1e-3, 1.0, 100.0}) {
    EXPECT_EQ(tree.BestChild(SearchTree::kRoot, exploration, tree.Range()), 2) << exploration;
  }
}

// After 5 more visits of state 2 with value -3: Q̄ = (0, 1), n = 8, n_i = (2, 6). State 0 wins if
// C (√(ln 8 / 2) - √(ln 8 / 6)) > 1, that is C > 2.3203.
TEST(SearchTree, ExplorationWeighsRareAgainstGood) {
  SearchTree tree = SmallTree();
  for (int i = 0; i < 5; ++i) {
    tree.Record(SearchTree::kRoot, -3.0);
    tree.Record(tree.Child(SearchTree::kRoot, 2), -3.0);
  }
  const double turning_point =
      1.0 / (std::sqrt(std::log(8.0) / 2.0) - std::sqrt(std::log(8.0) / 6.0));
  EXPECT_NEAR(turning_point, 2.3203, 1e-3);
  EXPECT_EQ(tree.BestChild(SearchTree::kRoot, turning_point - 0.01, tree.Range()), 2);
  EXPECT_EQ(tree.BestChild(SearchTree::kRoot, turning_point + 0.01, tree.Range()), 0);
}

TEST(SearchTree, OfEqualChildrenTheFirst) {
  SearchTree tree(2);
  for (const int state : {1, 0}) {
    const int child = tree.Expand(SearchTree::kRoot, state);
    tree.Record(child, -1.0);
    tree.Record(SearchTree::kRoot, -1.0);
  }
  EXPECT_EQ(tree.BestChild(SearchTree::kRoot, 1.0, tree.Range()), 0);
}

}  // namespace
}  // namespace shiftmap
