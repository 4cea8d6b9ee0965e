// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

#include "mapper/parallel.h"

namespace shiftmap {
namespace {

using Lists = std::vector<std::vector<int>>;

// Cells of a square floor, each a clique of its four corners.
Lists Floor(int edge, int first = 0) {
  Lists cliques;
  for (int x = 0; x + 1 < edge; ++x) {
    for (int y = 0; y + 1 < edge; ++y) {
      const int at = first + x * edge + y;
      cliques.push_back({at, at + 1, at + edge, at + edge + 1});
    }
  }
  return cliques;
}

std::vector<int> Ones(std::size_t nodes) { return std::vector<int>(nodes, 1); }

bool IsPermutation(std::vector<int> order) {
  std::sort(order.begin(), order.end());
  for (std::size_t i = 0; i < order.size(); ++i) {
    if (order[i] != static_cast<int>(i)) return false;
  }
  return true;
}

// Entries of the factor, by elimination as it is defined.
std::size_t Fill(const std::vector<int>& order, const Lists& cliques) {
  std::vector<std::set<int>> neighbours(order.size());
  for (const std::vector<int>& clique : cliques) {
    for (const int a : clique) {
      for (const int b : clique) {
        if (a != b) neighbours[static_cast<std::size_t>(a)].insert(b);
      }
    }
  }
  std::size_t fill = 0;
  for (const int node : order) {
    const std::set<int> later = std::move(neighbours[static_cast<std::size_t>(node)]);
    fill += later.size() + 1;
    for (const int a : later) {
      std::set<int>& of_a = neighbours[static_cast<std::size_t>(a)];
      of_a.erase(node);
      of_a.insert(later.begin(), later.end());
      of_a.erase(a);
    }
  }
  return fill;
}

TEST(EliminationOrder, DissectionFillsLittleOnAFloor) {
  const Lists cliques = Floor(40);
  const std::vector<int> order = DissectionOrder(Ones(1600), cliques);
  ASSERT_EQ(order.size(), 1600u);
  ASSERT_TRUE(IsPermutation(order));
  std::vector<int> row_by_row(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) row_by_row[i] = static_cast<int>(i);
  const std::size_t fill = Fill(order, cliques);
  EXPECT_LT(fill, 3 * Fill(row_by_row, cliques) / 4);
  EXPECT_LT(fill, 11 * Fill(MinimumDegreeOrder(1600, cliques), cliques) / 10);
}

TEST(EliminationOrder, PartsThatDoNotCoupleAreOrderedToo) {
  Lists cliques = Floor(20);
  for (std::vector<int>& clique : Floor(20, 400)) cliques.push_back(clique);
  EXPECT_TRUE(IsPermutation(DissectionOrder(Ones(810), cliques)));  // Ten couple with none.
  EXPECT_TRUE(IsPermutation(DissectionOrder({}, {})));
}

TEST(EliminationOrder, WhatNothingTakesApartIsOrderedAllTheSame) {
  Lists cliques(1);
  for (int node = 0; node < 300; ++node) cliques.front().push_back(node);
  EXPECT_TRUE(IsPermutation(DissectionOrder(Ones(300), cliques)));
}

// A strip whose middle is one wide node: it is cheaper to cut beside it.
TEST(EliminationOrder, DissectionCutsWhereFewUnknownsAre) {
  constexpr int kNodes = 301;
  Lists cliques;
  for (int node = 0; node + 1 < kNodes; ++node) cliques.push_back({node, node + 1});
  std::vector<int> sizes = Ones(kNodes);
  sizes[kNodes / 2] = 100;
  EXPECT_NE(DissectionOrder(sizes, cliques).back(), kNodes / 2);
}

TEST(EliminationOrder, DissectionIsTheSameInEveryThread) {
  const Lists cliques = Floor(30);
  const std::vector<int> alone = DissectionOrder(Ones(900), cliques);
  std::vector<std::vector<int>> orders(8);
  ForEachIndex(
      orders.size(), 4, [&](std::size_t i) { orders[i] = DissectionOrder(Ones(900), cliques); });
  for (const std::vector<int>& order : orders) EXPECT_EQ(order, alone);
}

}  // namespace
}  // namespace shiftmap
