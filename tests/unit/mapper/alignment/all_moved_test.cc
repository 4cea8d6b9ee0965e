// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/all_moved.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace shiftmap {
namespace {

constexpr double kArea = 64.0;

JointPoints Points(const std::vector<Eigen::Vector2d>& positions) {
  constexpr double kSd = 0.05;
  JointPoints points;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    points.points.push_back({GroupIndex(i), positions[i]});
  }
  const auto rows = static_cast<Eigen::Index>(2 * positions.size());
  points.covariance = kSd * kSd * Eigen::MatrixXd::Identity(rows, rows);
  return points;
}

class AllMovedTest : public testing::Test {
 protected:
  double LogMoved(MatchIndex landmark, const SimilarityFit& x) const {
    const Eigen::Vector2d r =
        evidence_.PositionInOther(landmark) - x * evidence_.PositionInReference(landmark);
    return evidence_.LogMovedBy(r, evidence_.Variance(landmark) * Eigen::Matrix2d::Identity());
  }

  // The oracle: ∫ (Π p(d | moved, x) - none near) p(x) dx by a sum over a grid.
  double LogSumOverGrid() const {
    constexpr double kReach = 7.0;
    constexpr double kStep = 0.25;
    constexpr int kTurns = 120;
    const double none = evidence_.LogAllAnywhere();
    double sum = 0.0;
    SimilarityFit x;
    for (int turn = 0; turn < kTurns; ++turn) {
      x.yaw_rad = 2.0 * std::numbers::pi * turn / kTurns;
      for (double dx = -kReach; dx <= kReach; dx += kStep) {
        for (double dy = -kReach; dy <= kReach; dy += kStep) {
          x.centre_other = {dx, dy};
          double log_density = 0.0;
          for (const MatchIndex landmark : evidence_.matches().indices()) {
            log_density += LogMoved(landmark, x);
          }
          sum += std::exp(log_density - none) - 1.0;
        }
      }
    }
    sum *= kStep * kStep / (kTurns * kArea);
    return none + std::log(sum);
  }

  // Around the origin, so that a transform is where the origin goes and a turn.
  const JointPoints reference_ =
      Points({{-3.0, -1.0}, {2.5, -2.0}, {0.5, 3.0}, {-2.0, 2.0}, {3.0, 1.5}, {-0.5, -2.5}});
  const JointPoints other_ =
      Points({{-3.3, -0.8}, {2.5, -2.6}, {0.2, 3.2}, {-2.9, 2.6}, {-1.0, -0.5}, {-0.1, -2.5}});
  const MovePrior prior_{};
  const AlignmentEvidence evidence_{reference_, other_, kArea, prior_};
  const std::vector<SimilarityFit> starts_ = {evidence_.Score(MatchSet::OfBits(0b001111)).fit,
                                              evidence_.Score(MatchSet::OfBits(0b100011)).fit,
                                              evidence_.Score(MatchSet::OfBits(0b001101)).fit,
                                              evidence_.Score(MatchSet::OfBits(0b010001)).fit};
};

TEST_F(AllMovedTest, IsTheIntegralOverTheTransform) {
  const double expected = LogSumOverGrid();
  EXPECT_NEAR(LogAllMovedSomeNear(evidence_, starts_), expected, 0.2);
}

// Where one landmark is near, any turn about it is as good: draws are from more than a whole turn.
TEST_F(AllMovedTest, AStartThatDoesNotTellTheHeadingAddsNothing) {
  std::vector<SimilarityFit> starts = starts_;
  for (const double yaw_rad : {1.0, 2.0, 3.0, 4.0}) {
    SimilarityFit& start = starts.emplace_back();
    start.yaw_rad = yaw_rad;
    start.centre_other = evidence_.PositionInOther(4) - start * evidence_.PositionInReference(4);
  }
  EXPECT_NEAR(LogAllMovedSomeNear(evidence_, starts), LogSumOverGrid(), 0.2);
}

TEST_F(AllMovedTest, WithoutAStartNoneIsNear) {
  EXPECT_EQ(LogAllMovedSomeNear(evidence_, {}), -std::numeric_limits<double>::infinity());
}

}  // namespace
}  // namespace shiftmap
