// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>

#include "tests/support/random_map.h"
#include "tools/experiment/alignments_comparators.h"

namespace shiftmap {
namespace {

constexpr double kTolerance = 0.4;

std::uint64_t Seed() { return testing::TestSeed(1); }

std::vector<AlignmentWorld> Worlds() {
  std::vector<AlignmentWorld> worlds;
  for (std::size_t i = 0; i < kAlignmentWorlds; ++i) {
    worlds.push_back(static_cast<AlignmentWorld>(i));
  }
  return worlds;
}

// The mean of chi-square is its degrees of freedom.
TEST(AlignmentsWorldTest, ErrorsAreAsTheCovarianceHasThem) {
  for (const AlignmentWorld world : Worlds()) {
    double sum = 0.0;
    double dof = 0.0;
    for (std::uint64_t i = 0; i < 60; ++i) {
      const AlignmentPair pair = DrawAlignmentPair(world, Seed() + i);
      Eigen::VectorXd errors(pair.reference.covariance.rows());
      for (std::size_t k = 0; k < pair.places.size(); ++k) {
        errors.segment<2>(static_cast<Eigen::Index>(2 * k)) =
            pair.reference.points[ModeIndex(k)].position - pair.places[k];
      }
      sum += errors.dot(pair.reference.covariance.llt().solve(errors));
      dof += static_cast<double>(errors.size());
    }
    EXPECT_NEAR(sum, dof, 4.0 * std::sqrt(2.0 * dof)) << ToString(world) << ", seed " << Seed();
  }
}

TEST(AlignmentsWorldTest, WhatStayedIsWhereTheTransformHasIt) {
  for (const AlignmentWorld world : Worlds()) {
    for (std::uint64_t i = 0; i < 20; ++i) {
      const AlignmentPair pair = DrawAlignmentPair(world, Seed() + i);
      const Eigen::Matrix2d R = pair.scale * pair.T_other_reference.Rotation();
      int there = 0;
      for (const AlignmentPoint& point : pair.other.points) {
        bool is_there = false;
        for (std::size_t k = 0; k < pair.places.size(); ++k) {
          const Eigen::Vector2d p = pair.T_other_reference.translation() + R * pair.places[k];
          is_there |= pair.reference.points[ModeIndex(k)].group == point.group &&
                      (point.position - p).norm() < 1.0;
        }
        there += is_there;
      }
      EXPECT_GE(there, pair.stayed) << ToString(world) << ", seed " << Seed() + i;
      EXPECT_LE(pair.stayed, std::ssize(pair.other.points));
    }
  }
}

TEST(AlignmentsWorldTest, AFrameIsRightWithinTheTolerance) {
  const AlignmentPair pair = DrawAlignmentPair(AlignmentWorld::kSpread, Seed());
  Alignment alignment;
  alignment.T_reference_other = pair.T_other_reference.Inverse();
  EXPECT_TRUE(pair.IsRight(alignment, kTolerance));
  alignment.T_reference_other = Se2(0.39, 0.0, 0.0) * alignment.T_reference_other;
  EXPECT_TRUE(pair.IsRight(alignment, kTolerance));
  alignment.T_reference_other = Se2(0.02, 0.0, 0.0) * alignment.T_reference_other;
  EXPECT_FALSE(pair.IsRight(alignment, kTolerance));
}

TEST(AlignmentsTest, DoesNotDependOnThreads) {
  for (const AlignmentWorld world : Worlds()) {
    const std::vector<AlignmentOutcome> once = AlignPairs(world, Seed(), 10, 1);
    const std::vector<AlignmentOutcome> again = AlignPairs(world, Seed(), 10, 2);
    for (std::size_t i = 0; i < once.size(); ++i) {
      EXPECT_EQ(once[i].stayed, again[i].stayed);
      EXPECT_EQ(once[i].probability, again[i].probability);
      EXPECT_EQ(once[i].of_right, again[i].of_right);
      for (std::size_t method = 0; method < kAlignmentMethods; ++method) {
        EXPECT_EQ(once[i].answers[method].right, again[i].answers[method].right);
      }
    }
  }
}

// The oracle: pairs that are drawn from the prior. A probability is then how often it is right.
TEST(AlignmentsTest, ProbabilitiesAreFrequenciesWhereThePriorIsRight) {
  const std::vector<AlignmentOutcome> outcomes = AlignPairs(AlignmentWorld::kPrior, Seed(), 400, 2);
  double expected = 0.0;
  double right = 0.0;
  double variance = 0.0;
  for (const AlignmentOutcome& outcome : outcomes) {
    expected += outcome.probability;
    right += outcome.is_right;
    variance += outcome.probability * (1.0 - outcome.probability);
  }
  EXPECT_NEAR(right, expected, 4.0 * std::sqrt(variance)) << "seed " << Seed();
  const AlignmentTally tally = TallyOf(AlignmentMethod::kPosterior, outcomes);
  EXPECT_GT(tally.decided, 100.0);
  EXPECT_LE(tally.wrong, 0.01 * tally.decided + 3.0 * std::sqrt(0.01 * tally.decided));
}

TEST(AlignmentsTest, TalliesCountAnswers) {
  AlignmentOutcome right;
  right.probability = 0.995;
  right.is_right = true;
  right.of_right = 1.0;
  right.answers[0] = {true, 1.0};
  AlignmentOutcome wrong = right;
  wrong.is_right = false;
  wrong.of_right = 0.0;
  wrong.answers[0] = {false, 2.0};
  AlignmentOutcome waits = wrong;
  waits.probability = 0.6;
  waits.of_right = std::exp(-2.0);
  waits.answers[0] = {std::nullopt, 3.0};
  const std::vector<AlignmentOutcome> outcomes = {right, wrong, waits};

  const AlignmentTally tally = TallyOf(AlignmentMethod::kPosterior, outcomes);
  EXPECT_EQ(tally.pairs, 3.0);
  EXPECT_EQ(tally.decided, 2.0);
  EXPECT_EQ(tally.wrong, 1.0);
  EXPECT_EQ(tally.median_s, 2.0);
  const PosteriorTally posterior = TallyPosterior(outcomes);
  EXPECT_NEAR(posterior.log_score, (0.0 + std::log(1e-6) - 2.0) / 3.0, 1e-12);
  EXPECT_EQ(posterior.waiting, 1.0);
  EXPECT_EQ(posterior.among_kept, 1.0);
  const std::vector<CalibrationBin> bins = Calibrate(outcomes);
  EXPECT_EQ(bins[1].pairs, 1.0);
  EXPECT_EQ(bins[3].pairs, 2.0);
  EXPECT_EQ(bins[3].right, 1.0);
  EXPECT_NEAR(bins[3].expected, 1.99, 1e-12);
}

}  // namespace
}  // namespace shiftmap
