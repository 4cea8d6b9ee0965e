// SPDX-License-Identifier: Apache-2.0
#include "mapper/submaps/confirm_alignment.h"

#include <gtest/gtest.h>

#include <vector>

namespace shiftmap {
namespace {

constexpr double kArea = 100.0;

const std::vector<Eigen::Vector2d> kPlaces = {{0.0, 0.0},
                                              {1.0, 0.2},
                                              {0.3, 1.1},
                                              {1.4, 1.3},
                                              {0.7, 2.2},
                                              {6.0, 0.5},
                                              {7.1, 3.4},
                                              {5.2, 6.4},
                                              {8.3, 8.9}};

// Of a landmark in each of the places, the first `moved` displaced by `by`.
std::vector<AlignmentPoint> Points(std::size_t moved, const Eigen::Vector2d& by, double sd_m) {
  std::vector<AlignmentPoint> points;
  for (std::size_t i = 0; i < kPlaces.size(); ++i) {
    points.push_back({static_cast<int>(i),
                      kPlaces[i] + (i < moved ? by : Eigen::Vector2d::Zero()),
                      sd_m * sd_m * Eigen::Matrix2d::Identity()});
  }
  return points;
}

bool NeedsConfirmation(const std::vector<AlignmentPoint>& points) {
  const MapperOptions options;
  Submap submap;
  submap.points = points;
  const std::vector<AlignmentPoint> reference = Points(0, Eigen::Vector2d::Zero(), 0.01);
  return shiftmap::NeedsConfirmation(
      options,
      reference,
      kArea,
      submap,
      AlignByConsensus(reference, submap.points, kArea, options.alignment));
}

TEST(NeedsConfirmation, MostThatAgreeAreEnough) {
  EXPECT_FALSE(NeedsConfirmation(Points(0, Eigen::Vector2d::Zero(), 0.01)));
  EXPECT_FALSE(NeedsConfirmation(Points(2, {1.0, 0.5}, 0.01)));
}

// Which of two bodies stayed: more than half agree if it was the larger one.
TEST(NeedsConfirmation, AnotherBodyMayHaveStayed) {
  EXPECT_TRUE(NeedsConfirmation(Points(5, {1.0, 0.5}, 0.01)));
  EXPECT_TRUE(NeedsConfirmation(Points(4, {1.0, 0.5}, 0.01)));
  EXPECT_TRUE(NeedsConfirmation(Points(3, {1.0, 0.5}, 0.01)));
}

TEST(NeedsConfirmation, ARunThatIsBentShowsNoBodies) {
  EXPECT_FALSE(NeedsConfirmation(Points(4, {1.0, 0.5}, 0.2)));
}

TEST(NeedsConfirmation, WithoutAConsensusItDoes) { EXPECT_TRUE(NeedsConfirmation({})); }

}  // namespace
}  // namespace shiftmap
