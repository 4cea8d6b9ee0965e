// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments_comparators.h"

#include <gtest/gtest.h>

#include <bit>
#include <random>

#include "mapstore/run/trajectory.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

std::uint64_t Seed() { return testing::TestSeed(1); }

std::vector<std::uint64_t> RandomGraph(int vertices, double density, std::mt19937_64* random) {
  std::bernoulli_distribution edge(density);
  std::vector<std::uint64_t> neighbours(static_cast<std::size_t>(vertices));
  for (int i = 0; i < vertices; ++i) {
    for (int j = 0; j < i; ++j) {
      if (!edge(*random)) continue;
      neighbours[static_cast<std::size_t>(i)] |= std::uint64_t{1} << j;
      neighbours[static_cast<std::size_t>(j)] |= std::uint64_t{1} << i;
    }
  }
  return neighbours;
}

bool IsClique(const std::vector<std::uint64_t>& neighbours, std::uint64_t set) {
  for (std::uint64_t left = set; left != 0; left &= left - 1) {
    const std::uint64_t vertex = left & -left;
    const std::uint64_t others = set & ~vertex;
    const auto index = static_cast<std::size_t>(std::countr_zero(vertex));
    if ((neighbours[index] & others) != others) return false;
  }
  return true;
}

// The oracle: all subsets.
TEST(MaximumCliqueTest, IsTheLargestOfAllSubsets) {
  std::mt19937_64 random(Seed());
  for (int round = 0; round < 60; ++round) {
    const int vertices = 1 + round % 12;
    const auto graph = RandomGraph(vertices, 0.1 + 0.8 * (round % 7) / 6.0, &random);
    int largest = 0;
    for (std::uint64_t set = 1; set < std::uint64_t{1} << vertices; ++set) {
      if (IsClique(graph, set)) largest = std::max(largest, std::popcount(set));
    }
    const std::vector<int> clique = MaximumClique(graph);
    std::uint64_t found = 0;
    for (const int vertex : clique) found |= std::uint64_t{1} << vertex;
    EXPECT_TRUE(IsClique(graph, found)) << "round " << round << ", seed " << Seed();
    EXPECT_EQ(std::ssize(clique), largest) << "round " << round << ", seed " << Seed();
  }
}

TEST(MaximumCliqueTest, TakesAsManyVerticesAsThereAreBits) {
  std::mt19937_64 random(Seed());
  EXPECT_TRUE(MaximumClique({}).empty());
  EXPECT_EQ(MaximumClique(RandomGraph(64, 1.0, &random)).size(), 64U);
  EXPECT_EQ(MaximumClique(RandomGraph(64, 0.0, &random)).size(), 1U);
}

// Landmarks in two maps, the last ones displaced.
std::vector<PlacedTwice> Landmarks(const Se2& T_reference_other,
                                   int count,
                                   int displaced,
                                   std::mt19937_64* random) {
  constexpr double kSd = 0.05;
  const auto places = testing::RandomPositions(*random, count, 5.0);
  const auto errors = testing::RandomPositions(*random, count, kSd);
  std::uniform_real_distribution<double> move(2.0, 4.0);
  std::vector<PlacedTwice> landmarks;
  for (int i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    landmarks.push_back({T_reference_other * places[at] + errors[at], places[at], kSd * kSd});
    if (i >= count - displaced) landmarks.back().reference.x() += move(*random);
  }
  return landmarks;
}

double Apart(const Se2& a, const Se2& b) { return (a.Inverse() * b).Log().norm(); }

// The oracle: least squares where all weights are equal, for which there is a function.
TEST(GraduatedWeightsTest, WithoutOutliersItIsLeastSquares) {
  std::mt19937_64 random(Seed());
  const Se2 T(3.0, -2.0, 2.5);
  for (int round = 0; round < 20; ++round) {
    const std::vector<PlacedTwice> landmarks = Landmarks(T, 3 + round, 0, &random);
    std::vector<PointPair> pairs;
    for (const PlacedTwice& landmark : landmarks) {
      pairs.push_back({landmark.reference, landmark.other});
    }
    const std::vector<double> weights = GraduatedWeights(landmarks, 25.0);
    EXPECT_EQ(weights, std::vector<double>(landmarks.size(), 1.0)) << "seed " << Seed();
    const StatusOr<Se2> expected = AlignRigid2d(pairs);
    ASSERT_TRUE(expected.ok());
    EXPECT_LT(Apart(FitRigid(landmarks, weights), *expected), 1e-9) << "seed " << Seed();
  }
}

TEST(GraduatedWeightsTest, LeavesOutWhatMoved) {
  std::mt19937_64 random(Seed());
  const Se2 T(3.0, -2.0, 2.5);
  for (int round = 0; round < 20; ++round) {
    const std::vector<PlacedTwice> landmarks = Landmarks(T, 20, 5, &random);
    const std::vector<double> weights = GraduatedWeights(landmarks, 25.0);
    std::vector<double> expected(15, 1.0);
    expected.resize(20, 0.0);
    EXPECT_EQ(weights, expected) << "round " << round << ", seed " << Seed();
  }
}

// A weight of two is the landmark twice.
TEST(FitRigidTest, WeightsCountLandmarks) {
  std::mt19937_64 random(Seed());
  std::vector<PlacedTwice> landmarks = Landmarks(Se2(1.0, 2.0, -0.7), 5, 1, &random);
  const Se2 weighted = FitRigid(landmarks, std::vector<double>{2.0, 1.0, 1.0, 0.0, 1.0});
  landmarks[3] = landmarks[0];
  EXPECT_LT(Apart(FitRigid(landmarks, std::vector<double>(5, 1.0)), weighted), 1e-9);
}

}  // namespace
}  // namespace shiftmap
