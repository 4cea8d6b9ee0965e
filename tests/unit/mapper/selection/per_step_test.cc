// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/per_step.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/unit/mapper/selection/random_sequence.h"

namespace shiftmap {
namespace {

using testing::IsNearMatrix;

// Two states; the first is a priori nine times as likely and is rarely left.
ModeSequenceProblem TwoStates(const Eigen::MatrixXd& log_likelihood) {
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector2d(std::log(0.9), std::log(0.1));
  Eigen::Matrix2d transition;
  transition << 0.8, 0.2, 0.4, 0.6;
  problem.log_transition.assign(static_cast<std::size_t>(log_likelihood.rows()) - 1,
                                transition.array().log());
  problem.log_likelihood = log_likelihood;
  return problem;
}

TEST(NearestNeighborModes, LookAtTheLikelihoodAlone) {
  Eigen::MatrixXd log_likelihood(3, 2);
  log_likelihood << -1.0, -0.9, 0.0, -30.0, -4.0, -3.0;
  EXPECT_EQ(NearestNeighborModes(TwoStates(log_likelihood), 1), (std::vector<int>{1, 0, 1}));
}

TEST(NearestNeighborModes, DrawAmongEqualStatesBySeed) {
  ModeSequenceProblem problem;
  problem.log_initial = Eigen::Vector3d::Zero();
  problem.log_transition.assign(299, Eigen::Matrix3d::Zero());
  problem.log_likelihood = Eigen::MatrixXd::Zero(300, 3);
  problem.log_likelihood.col(1).setConstant(-1.0);
  const std::vector<int> states = NearestNeighborModes(problem, 7);
  EXPECT_EQ(std::set<int>(states.begin(), states.end()), (std::set<int>{0, 2}));
  const auto zeros = std::count(states.begin(), states.end(), 0);
  EXPECT_GT(zeros, 110);
  EXPECT_LT(zeros, 190);
  EXPECT_EQ(NearestNeighborModes(problem, 7), states);
  EXPECT_NE(NearestNeighborModes(problem, 8), states);
}

TEST(MaxMixtureModes, WeighTheLikelihoodWithTheInitialDistribution) {
  Eigen::MatrixXd log_likelihood(3, 2);
  const double weight = std::log(9.0);
  log_likelihood << 0.0, weight - 0.01, 0.0, weight + 0.01, -5.0, 0.0;
  EXPECT_EQ(MaxMixtureModes(TwoStates(log_likelihood)), (std::vector<int>{0, 1, 1}));
}

TEST(MaxMixtureModes, KnowNoNegativeInformation) {
  Eigen::MatrixXd log_likelihood(4, 2);
  log_likelihood << -20.0, 0.0, -9.0, 0.0, -20.0, 0.0, 0.0, -9.0;
  ModeSequenceProblem problem = TwoStates(log_likelihood);
  problem.missed = {true, false, true, true};
  // Before anything is seen the likeliest component of the mixture, then the one seen last.
  EXPECT_EQ(MaxMixtureModes(problem), (std::vector<int>{0, 1, 1, 1}));
  EXPECT_EQ(NearestNeighborModes(problem, 1), (std::vector<int>{1, 1, 1, 0}));
}

TEST(ExpectationPosteriors, AreTheChainsPriorTimesTheLikelihood) {
  Eigen::MatrixXd log_likelihood(2, 2);
  log_likelihood << std::log(0.5), std::log(0.25), std::log(0.1), std::log(0.3);
  // p(δ_1) = (0.9, 0.1), p(δ_2) = (0.9 * 0.8 + 0.1 * 0.4, ...) = (0.76, 0.24).
  Eigen::MatrixXd expected(2, 2);
  expected << 0.45 / 0.475, 0.025 / 0.475, 0.076 / 0.148, 0.072 / 0.148;
  const ModeSequenceProblem problem = TwoStates(log_likelihood);
  EXPECT_THAT(ExpectationPosteriors(problem), IsNearMatrix(expected, 1e-12));
  EXPECT_EQ(LargestPerStep(ExpectationPosteriors(problem)), (std::vector<int>{0, 0}));
}

TEST(ExpectationPosteriors, DoNotKnowTheOtherObservations) {
  std::mt19937_64 random(testing::TestSeed(31));
  ModeSequenceProblem problem = testing::RandomSequence(random, 3, 6);
  const Eigen::MatrixXd before = ExpectationPosteriors(problem);
  problem.log_likelihood.row(2) << 0.0, -50.0, -50.0;
  const Eigen::MatrixXd after = ExpectationPosteriors(problem);
  EXPECT_THAT(after.topRows(2).eval(), IsNearMatrix(before.topRows(2), 1e-15));
  EXPECT_THAT(after.bottomRows(3).eval(), IsNearMatrix(before.bottomRows(3), 1e-15));
  EXPECT_NEAR(after(2, 0), 1.0, 1e-12);
}

// With a uniform start and a symmetric chain (23) is the normalized likelihood.
TEST(ExpectationPosteriors, AreNearestNeighborsWhereTheChainSaysNothing) {
  std::mt19937_64 random(testing::TestSeed(32));
  for (int trial = 0; trial < 20; ++trial) {
    const ModeSequenceProblem problem =
        testing::StickySequence(random, {0, 0, 1, 1, 2, 2}, 3, 1e-4, 1.0);
    EXPECT_EQ(LargestPerStep(ExpectationPosteriors(problem)), NearestNeighborModes(problem, 1));
  }
}

}  // namespace
}  // namespace shiftmap
