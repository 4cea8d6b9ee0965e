// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/elimination_order.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>
#include <vector>

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
  const std::vector<int> order = DissectionOrder(1600, cliques);
  ASSERT_EQ(order.size(), 1600u);
  ASSERT_TRUE(IsPermutation(order));
  std::vector<int> row_by_row(order.size());
  for (std::size_t i = 0; i < order.size(); ++i) row_by_row[i] = static_cast<int>(i);
  const std::size_t fill = Fill(order, cliques);
  EXPECT_LT(fill, 3 * Fill(row_by_row, cliques) / 4);
  EXPECT_LT(fill, 3 * Fill(MinimumDegreeOrder(1600, cliques), cliques) / 2);
}

TEST(EliminationOrder, PartsThatDoNotCoupleAreOrderedToo) {
  Lists cliques = Floor(20);
  for (std::vector<int>& clique : Floor(20, 400)) cliques.push_back(clique);
  EXPECT_TRUE(IsPermutation(DissectionOrder(810, cliques)));  // Ten couple with none.
  EXPECT_TRUE(IsPermutation(DissectionOrder(0, {})));
}

TEST(EliminationOrder, WhatNothingTakesApartIsOrderedAllTheSame) {
  Lists cliques(1);
  for (int node = 0; node < 300; ++node) cliques.front().push_back(node);
  EXPECT_TRUE(IsPermutation(DissectionOrder(300, cliques)));
}

}  // namespace
}  // namespace shiftmap
