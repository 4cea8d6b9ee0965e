// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/displacement_prior.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>
#include <vector>

namespace shiftmap {
namespace {

// Log probability of one cluster: the likeliest tree over `members` (every one of them hangs on any
// other, and what does not connect all is no tree), and everything else stays.
double BruteForce(const std::vector<Eigen::Vector2d>& positions,
                  const std::vector<std::size_t>& members,
                  double length_m,
                  const DisplacementPriorOptions& options) {
  const double anywhere = options.others_anywhere / static_cast<double>(positions.size());
  const auto along = [&](std::size_t a, std::size_t b) {
    const double r = (positions[a] - positions[b]).norm() / length_m;
    return anywhere + (options.probability_with_neighbour - anywhere) * std::exp(-r * r);
  };
  const std::size_t count = members.size();
  double best = -std::numeric_limits<double>::infinity();
  std::size_t combinations = 1;
  for (std::size_t i = 1; i < count; ++i) combinations *= count;
  for (std::size_t code = 0; code < combinations; ++code) {
    std::vector<std::size_t> parent(count, 0);
    for (std::size_t i = 1, rest = code; i < count; ++i, rest /= count) parent[i] = rest % count;
    double log_probability = std::log(options.probability_displaced);
    bool tree = true;
    for (std::size_t i = 1; i < count; ++i) {
      std::size_t root = i;
      for (std::size_t step = 0; step < count; ++step) root = root == 0 ? 0 : parent[root];
      tree &= root == 0;
      log_probability += std::log(along(members[i], members[parent[i]]));
    }
    if (tree) best = std::max(best, log_probability);
  }
  for (std::size_t i = 0; i < positions.size(); ++i) {
    if (std::find(members.begin(), members.end(), i) != members.end()) continue;
    double most = 0.0;
    for (const std::size_t member : members) most = std::max(most, along(i, member));
    best += std::log(1.0 - most);
  }
  return best;
}

std::vector<int> OneCluster(std::size_t count, const std::vector<std::size_t>& members) {
  std::vector<int> clusters(count, -1);
  for (const std::size_t member : members) clusters[member] = 0;
  return clusters;
}

TEST(DisplacementPrior, IsThatOfTheLikeliestTreeAndOfWhatStays) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> anywhere(0.0, 10.0);
  const DisplacementPriorOptions options;
  for (int trial = 0; trial < 20; ++trial) {
    std::vector<Eigen::Vector2d> positions;
    for (int i = 0; i < 9; ++i) positions.emplace_back(anywhere(random), anywhere(random));
    std::vector<double> nearest;
    for (const Eigen::Vector2d& a : positions) {
      std::vector<double> distances;
      for (const Eigen::Vector2d& b : positions) distances.push_back((a - b).norm());
      std::sort(distances.begin(), distances.end());
      nearest.push_back(distances[1]);
    }
    std::sort(nearest.begin(), nearest.end());
    const double length_m = options.neighbourhood * nearest[4];
    const std::vector<std::size_t> members = {1, 3, 4, 6, 8};
    EXPECT_NEAR(DisplacementPrior(positions, options).LogProbability(OneCluster(9, members)),
                BruteForce(positions, members, length_m, options),
                1e-12);
  }
}

TEST(DisplacementPrior, IsTheSameInAnyOrderAndUnit) {
  const std::vector<Eigen::Vector2d> positions = {{0, 0}, {1, 0}, {2.5, 0.5}, {9, 3}, {4, 8}};
  const std::vector<Eigen::Vector2d> backwards(positions.rbegin(), positions.rend());
  std::vector<Eigen::Vector2d> in_feet;
  for (const Eigen::Vector2d& position : positions) in_feet.emplace_back(position / 0.3048);
  const double expected = DisplacementPrior(positions, {}).LogProbability({0, 0, 1, -1, 0});
  EXPECT_NEAR(DisplacementPrior(backwards, {}).LogProbability({0, -1, 1, 0, 0}), expected, 1e-12);
  EXPECT_NEAR(DisplacementPrior(in_feet, {}).LogProbability({0, 0, 1, -1, 0}), expected, 1e-12);
  EXPECT_NEAR(DisplacementPrior(positions, {}).LogProbability({3, 3, 1, -1, 3}), expected, 1e-12);
}

TEST(DisplacementPrior, ALandmarkGoesAlongOrStays) {
  const std::vector<Eigen::Vector2d> positions = {{0, 0}, {1, 0}};
  const DisplacementPriorOptions options;
  const DisplacementPrior prior(positions, options);
  EXPECT_NEAR(std::exp(prior.LogProbability({0, -1})) + std::exp(prior.LogProbability({0, 0})),
              options.probability_displaced,
              1e-12);
  EXPECT_EQ(prior.LogProbability({-1, -1}), 0.0);
}

TEST(DisplacementPrior, NeighboursRatherGoTogether) {
  const std::vector<Eigen::Vector2d> positions = {{0, 0}, {1, 0}, {20, 0}, {21, 0}};
  const DisplacementPrior prior(positions, {});
  EXPECT_GT(prior.LogProbability({0, 0, -1, -1}), prior.LogProbability({0, -1, 0, -1}));
  EXPECT_GT(prior.LogProbability({0, 0, -1, -1}), prior.LogProbability({0, 1, -1, -1}));
}

TEST(DisplacementPrior, LandmarksAtOnePlaceAreNeighbours) {
  const std::vector<Eigen::Vector2d> positions(3, Eigen::Vector2d(1.0, 2.0));
  const DisplacementPriorOptions options;
  const double along = options.probability_with_neighbour;
  EXPECT_NEAR(DisplacementPrior(positions, options).LogProbability({0, 0, -1}),
              std::log(options.probability_displaced * along * (1.0 - along)),
              1e-12);
}

TEST(DisplacementPrior, ThousandsThatStayDoNotUnderflow) {
  std::vector<Eigen::Vector2d> positions;
  for (int i = 0; i < 4000; ++i) positions.emplace_back(1.0, 2.0);
  std::vector<int> clusters(positions.size(), -1);
  clusters[0] = 0;
  const DisplacementPriorOptions options;
  EXPECT_NEAR(DisplacementPrior(positions, options).LogProbability(clusters),
              std::log(options.probability_displaced) +
                  3999.0 * std::log(1.0 - options.probability_with_neighbour),
              1e-6);
}

}  // namespace
}  // namespace shiftmap
