// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/consensus.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Points = std::vector<AlignmentPoint>;

constexpr double kSize = 20.0;  // Edge of the floor. [m]
constexpr double kSd = 0.03;    // Of a position, per axis and frame. [m]

class Consensus : public ::testing::Test {
 protected:
  Eigen::Vector2d Anywhere() {
    std::uniform_real_distribution<double> coordinate(0.0, kSize);
    const double x = coordinate(random_);
    return {x, coordinate(random_)};
  }

  Eigen::Vector2d Noise() {
    const double x = kSd * normal_(random_);
    return {x, kSd * normal_(random_)};
  }

  // `count` groups with one mode each, anywhere.
  Points RandomLayout(int count) {
    Points points;
    for (int group = 0; group < count; ++group) {
      points.push_back({GroupIndex(group), Anywhere(), kSd * kSd * Eigen::Matrix2d::Identity()});
    }
    return points;
  }

  // The first `stayed` points as seen in another frame, with noise; the others stand elsewhere.
  Points Other(const Points& reference, const Se2& T_reference_other, int stayed) {
    Points other = reference;
    for (std::size_t i = 0; i < other.size(); ++i) {
      if (static_cast<int>(i) >= stayed) other[i].position = Anywhere();
      other[i].position = T_reference_other.Inverse() * other[i].position + Noise();
    }
    return other;
  }

  std::mt19937_64 random_{testing::TestSeed(41)};
  std::normal_distribution<double> normal_;
};

// What stayed are three signs on one post: where they are is known, but not which way is up.
TEST_F(Consensus, SignsOnOnePostTellNoRotation) {
  const Se2 truth(3.0, -7.0, 2.1);
  int aligned = 0;
  for (const double post_m : {0.0, 0.02, 0.04}) {
    for (int trial = 0; trial < 20; ++trial) {
      Points reference = RandomLayout(10);
      reference[1].position = reference[0].position + Eigen::Vector2d(post_m, 0.0);
      reference[2].position = reference[0].position + Eigen::Vector2d(0.0, post_m);
      aligned += AlignByConsensus(reference, Other(reference, truth, 3), {}) ? 1 : 0;
    }
  }
  EXPECT_LE(aligned, 2);  // Of 60: several others may agree by accident.
}

// Others that stayed with them do, whatever the signs are worth.
TEST_F(Consensus, APostAmongOthersDoesNoHarm) {
  const Se2 truth(3.0, -7.0, 2.1);
  for (int trial = 0; trial < 20; ++trial) {
    Points reference = RandomLayout(12);
    reference[1].position = reference[0].position;
    reference[2].position = reference[0].position;
    const auto alignment = AlignByConsensus(reference, Other(reference, truth, 6), {});
    ASSERT_TRUE(alignment);
    EXPECT_NEAR(WrapAngle(alignment->T_reference_other.yaw() - truth.yaw()), 0.0, 0.05);
  }
}

TEST_F(Consensus, RecoversAKnownTransform) {
  const Se2 truth(3.0, -7.0, 2.1);
  const Points reference = RandomLayout(15);
  const auto alignment = AlignByConsensus(reference, Other(reference, truth, 15), {});
  ASSERT_TRUE(alignment.has_value());
  EXPECT_EQ(alignment->signatures.size(), 15u);
  EXPECT_THAT(alignment->T_reference_other, testing::IsNearPose(truth, 0.05));
}

TEST_F(Consensus, ThreeOfFifteenAreEnough) {
  int found = 0;
  int right = 0;
  constexpr int kTrials = 60;
  for (int trial = 0; trial < kTrials; ++trial) {
    const Se2 truth(2.0 * normal_(random_), 2.0 * normal_(random_), normal_(random_));
    const Points reference = RandomLayout(15);
    const auto alignment = AlignByConsensus(reference, Other(reference, truth, 3), {});
    if (!alignment) continue;
    ++found;
    const Se2 error = truth.Inverse() * alignment->T_reference_other;
    right += (truth * Eigen::Vector2d(5.0, 5.0) -
              alignment->T_reference_other * Eigen::Vector2d(5.0, 5.0))
                     .norm() < 0.5 &&
             std::abs(error.yaw()) < 0.1;
  }
  RecordProperty("found", found);
  RecordProperty("right", right);
  EXPECT_GE(right, kTrials * 9 / 10);
  EXPECT_GE(right, found * 9 / 10);
}

TEST_F(Consensus, AnyModeOfAGroupMayBeTheOneThatMatches) {
  const Se2 truth(-4.0, 1.0, -0.8);
  Points reference = RandomLayout(8);
  Points other = Other(reference, truth, 8);
  // Every group stood elsewhere too, in either frame, and what matches is listed last.
  Points more_reference = RandomLayout(8);
  Points more_other = RandomLayout(8);
  more_reference.insert(more_reference.end(), reference.begin(), reference.end());
  more_other.insert(more_other.end(), other.begin(), other.end());
  const auto alignment = AlignByConsensus(more_reference, more_other, {});
  ASSERT_TRUE(alignment.has_value());
  EXPECT_EQ(alignment->signatures.size(), 8u);
  EXPECT_THAT(alignment->T_reference_other, testing::IsNearPose(truth, 0.08));
}

TEST_F(Consensus, LayoutsWithNothingInCommonRarelyAlign) {
  constexpr int kTrials = 200;
  int aligned = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    aligned += AlignByConsensus(RandomLayout(12), RandomLayout(12), {}).has_value();
  }
  RecordProperty("aligned", aligned);
  EXPECT_LE(aligned, kTrials / 50);
}

TEST_F(Consensus, PositionsOfADecimetreNeedMoreThanThreeSignatures) {
  constexpr int kTrials = 200;
  int aligned = 0;
  int aligned_with_four = 0;
  for (int trial = 0; trial < kTrials; ++trial) {
    Points reference = RandomLayout(12);
    Points other = RandomLayout(12);
    for (Points* points : {&reference, &other}) {
      for (AlignmentPoint& point : *points) point.cov = 0.01 * Eigen::Matrix2d::Identity();
    }
    aligned += AlignByConsensus(reference, other, {}).has_value();
    AlignmentOptions options;
    options.min_signatures = 4;
    aligned_with_four += AlignByConsensus(reference, other, options).has_value();
  }
  RecordProperty("aligned", aligned);
  RecordProperty("aligned_with_four", aligned_with_four);
  // Three of twelve agree by accident now and then on a floor of 20 m; four hardly ever do.
  EXPECT_LE(aligned_with_four, kTrials / 20);
  EXPECT_LE(aligned_with_four, aligned);
}

TEST_F(Consensus, TheTransformWithMoreSupportersWins) {
  const Se2 first(2.0, 1.0, 0.5);
  const Se2 second(-3.0, 4.0, -1.5);
  const Points reference = RandomLayout(12);
  Points other = Other(reference, first, 12);
  const Points elsewhere = Other(reference, second, 12);
  std::copy(elsewhere.begin() + 8, elsewhere.end(), other.begin() + 8);
  const auto alignment = AlignByConsensus(reference, other, {});
  ASSERT_TRUE(alignment.has_value());
  EXPECT_THAT(alignment->T_reference_other, testing::IsNearPose(first, 0.1));
  EXPECT_EQ(alignment->signatures.size(), 8u);
}

TEST_F(Consensus, SensorsMayDisagreeAboutLengths) {
  const Se2 truth(1.0, 2.0, 0.4);
  const Points reference = RandomLayout(12);
  Points other = Other(reference, truth, 12);
  for (AlignmentPoint& point : other) point.position *= 1.02;
  const auto alignment = AlignByConsensus(reference, other, {});
  ASSERT_TRUE(alignment.has_value());
  EXPECT_EQ(alignment->signatures.size(), 12u);
  // A rigid transform cannot undo the scale; it has to be right at the centroid.
  const Eigen::Vector2d centroid = alignment->centroid;
  const Eigen::Vector2d in_other = 1.02 * (truth.Inverse() * centroid);
  EXPECT_LT((alignment->T_reference_other * in_other - centroid).norm(), 0.05);
  EXPECT_NEAR(alignment->T_reference_other.yaw(), 0.4, 0.01);
}

TEST_F(Consensus, MovesWithTheFrames) {
  const Points reference = RandomLayout(10);
  const Points other = Other(reference, Se2(1.0, -2.0, 0.5), 6);
  const auto alignment = AlignByConsensus(reference, other, {});
  ASSERT_TRUE(alignment.has_value());
  for (const double yaw : {-2.5, 0.3, 3.0}) {
    const Se2 T_new_other(4.0, 6.0, yaw);
    Points moved = other;
    for (AlignmentPoint& point : moved) point.position = T_new_other * point.position;
    const auto again = AlignByConsensus(reference, moved, {});
    ASSERT_TRUE(again.has_value());
    EXPECT_EQ(again->signatures, alignment->signatures);
    EXPECT_THAT(again->T_reference_other * T_new_other,
                testing::IsNearPose(alignment->T_reference_other, 1e-9));
  }
}

TEST_F(Consensus, FewerThanTheLeastNumberAreNone) {
  const Points reference = RandomLayout(2);
  EXPECT_FALSE(AlignByConsensus(reference, reference, {}).has_value());
  EXPECT_FALSE(AlignByConsensus({}, {}, {}).has_value());
  const Points three = RandomLayout(3);
  EXPECT_TRUE(AlignByConsensus(three, three, {}).has_value());
}

TEST_F(Consensus, TheVarianceOfAPositionIsWhatItScattersBy) {
  const Points truth = RandomLayout(8);
  const Eigen::Vector2d far(40.0, 10.0);
  AlignmentOptions options;
  options.position_floor_m = 0.0;
  options.max_scale_error = 0.0;
  double ratio = 0.0;
  constexpr int kTrials = 300;
  for (int trial = 0; trial < kTrials; ++trial) {
    Points reference = truth;
    for (AlignmentPoint& point : reference) point.position += Noise();
    const auto alignment = AlignByConsensus(reference, Other(truth, Se2(), 8), options);
    ASSERT_TRUE(alignment.has_value());
    // Per axis: half the mean square of the displacement.
    ratio += 0.5 * (alignment->T_reference_other * far - far).squaredNorm() /
             (alignment->PositionVariance(far) * kTrials);
  }
  // The variance is stated isotropic; the lever arm moves a far point across only.
  EXPECT_GT(ratio, 0.4);
  EXPECT_LT(ratio, 1.3);
}

}  // namespace
}  // namespace shiftmap
