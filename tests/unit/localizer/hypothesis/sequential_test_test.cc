// SPDX-License-Identifier: Apache-2.0
#include "localizer/hypothesis/sequential_test.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <random>

#include "localizer/hypothesis/known_map_leaf.h"
#include "localizer/hypothesis/leaf_reduction.h"
#include "localizer/hypothesis/visit.h"

namespace shiftmap {
namespace {

using ::testing::ElementsAre;

TEST(SequentialTest, ThresholdIsALogarithm) { EXPECT_NEAR(DecisionThreshold(1e-8), 18.42, 0.01); }

TEST(SequentialTest, DecidesOnlyAgainstEveryOther) {
  const double threshold = DecisionThreshold(0.01);
  const TestOutcome open = TestStates(Eigen::Vector3d(0.0, -1.0, -10.0), threshold);
  EXPECT_FALSE(open.decided);
  EXPECT_THAT(open.rejected, ElementsAre(2));
  const TestOutcome closed = TestStates(Eigen::Vector3d(-9.0, 0.0, -10.0), threshold);
  EXPECT_EQ(closed.decided, 1);
  EXPECT_NEAR(closed.log_odds, -std::log(std::exp(-9.0) + std::exp(-10.0)), 1e-12);
}

TEST(SequentialTest, ManyAlternativesCountTogether) {
  // Each of the others is below α of the first, but not all four of them.
  const double threshold = DecisionThreshold(0.01);
  Eigen::VectorXd scores = Eigen::VectorXd::Constant(5, -threshold - 0.5);
  scores[2] = 0.0;
  EXPECT_FALSE(TestStates(scores, threshold).decided);
  scores.array() -= std::log(4.0);
  scores[2] = 0.0;
  EXPECT_EQ(TestStates(scores, threshold).decided, 2);
}

TEST(SequentialTest, TwoEquallyRejectedStatesDoNotKeepEachOther) {
  const TestOutcome outcome =
      TestStates(Eigen::Vector3d(0.0, -20.0, -20.0), DecisionThreshold(1e-4));
  EXPECT_THAT(outcome.rejected, ElementsAre(1, 2));
}

// Shares of visits that end in a decision, of these the share of wrong ones and the probability of
// being wrong that the odds stated, and the share of decisions at the first sighting.
struct StoppedTests {
  double decided = 0.0;
  double wrong = 0.0;
  double stated = 0.0;
  double at_first = 0.0;
};

// Two modes 0.3 to 1 m apart, seen from a standing vehicle 3 to 7 m away by one who knows the model
// exactly: what sightings share (map, bias, start) and what each has for itself, by coordinate
// along and across the line of sight. Their mean is then all that counts.
StoppedTests DecideWithExactOdds(double alpha, double sd_start_m, int visits) {
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  const auto uniform = [&](double low, double high) {
    return std::uniform_real_distribution<double>(low, high)(random);
  };
  constexpr int kMaxSightings = 30;
  constexpr double kSdMap = 0.05;
  StoppedTests stopped;
  for (int visit = 0; visit < visits; ++visit) {
    const Eigen::Array2d sd(0.15, 0.03 * uniform(3.0, 7.0));
    const Eigen::Array2d shared =
        kSdMap * kSdMap + (0.5 * sd).square() + sd_start_m * sd_start_m;  // Variances.
    const double apart = uniform(0.3, 1.0);
    const double direction = uniform(-M_PI, M_PI);
    const Eigen::Array2d second(apart * std::cos(direction), apart * std::sin(direction));
    Eigen::Vector2d prior(uniform(0.1, 1.0), uniform(0.1, 1.0));
    prior /= prior.sum();
    const int truth = uniform(0.0, 1.0) < prior[0] ? 0 : 1;
    const Eigen::Array2d error(normal(random), normal(random));
    const Eigen::Array2d centre = truth * second + shared.sqrt() * error;
    Eigen::Array2d sum = Eigen::Array2d::Zero();
    for (int n = 1; n <= kMaxSightings; ++n) {
      const Eigen::Array2d noise(normal(random), normal(random));
      sum += centre + sd * noise;
      const Eigen::Array2d variance = shared + sd.square() / n;
      const Eigen::Vector2d scores(
          std::log(prior[0]) - 0.5 * ((sum / n).square() / variance).sum(),
          std::log(prior[1]) - 0.5 * ((sum / n - second).square() / variance).sum());
      const TestOutcome outcome = TestStates(scores, DecisionThreshold(alpha));
      if (!outcome.decided) continue;
      stopped.decided += 1.0;
      stopped.wrong += *outcome.decided != truth;
      stopped.stated += 1.0 / (1.0 + std::exp(outcome.log_odds));
      stopped.at_first += n == 1;
      break;
    }
  }
  stopped.wrong /= stopped.decided;
  stopped.stated /= stopped.decided;
  stopped.at_first /= stopped.decided;
  stopped.decided /= visits;
  return stopped;
}

// One sighting moves the odds by more than the threshold asks: even exact odds are far beyond it
// where they first pass it.
TEST(SequentialTest, OvershootAloneMakesDecisionsBetterThanAlpha) {
  constexpr int kVisits = 50000;
  const StoppedTests near = DecideWithExactOdds(0.1, 0.02, kVisits);
  EXPECT_NEAR(near.wrong, near.stated, 0.0025);  // Four standard deviations.
  EXPECT_NEAR(near.stated, 0.0140, 0.0005);
  EXPECT_NEAR(near.at_first, 0.85, 0.01);
  const StoppedTests vague = DecideWithExactOdds(0.1, 0.1, kVisits);
  EXPECT_NEAR(vague.wrong, vague.stated, 0.0025);
  EXPECT_NEAR(vague.stated, 0.0200, 0.0005);
  // What is known less well is told in smaller steps, and those overshoot less.
  EXPECT_GT(DecideWithExactOdds(0.1, 1.0, kVisits).stated, 0.03);
}

Leaf MakeLeaf(double weight, int resolved, const Eigen::Vector3d& p) {
  Leaf leaf{KnownMapFilter(PoseWithCovariance{Se2(), Eigen::Matrix3d::Identity()}, {}),
            std::log(weight),
            {},
            0};
  PlaceBelief belief;
  belief.resolved = resolved;
  for (const double share : p) belief.log_p.push_back(std::log(share));
  belief.log_missed.resize(3, 0.0);
  leaf.beliefs.push_back(belief);
  return leaf;
}

LeafSet<Leaf> SetOf(const std::vector<Leaf>& leaves) {
  LeafSet<Leaf> set;
  for (const Leaf& leaf : leaves) set.Add(leaf);
  return set;
}

Eigen::VectorXd Marginal(const LeafSet<Leaf>& leaves) {
  const StateValues marginal = MarginalLogProbability(leaves, 0);
  return AsVector(marginal);
}

TEST(LeafReduction, MergingKeepsTheMarginal) {
  const Eigen::Vector3d p(0.5, 0.25, 0.25);
  LeafSet<Leaf> leaves = SetOf({MakeLeaf(0.2, 1, p),
                                MakeLeaf(0.3, GroupBelief::kUnresolved, p),
                                MakeLeaf(0.4, 1, p),
                                MakeLeaf(0.1, GroupBelief::kUnresolved, {0.1, 0.1, 0.8})});
  const Eigen::VectorXd before = Marginal(leaves);
  MergeLeaves({true}, &leaves);
  ASSERT_EQ(leaves.size(), 2u);
  EXPECT_NEAR(std::exp(leaves[0].log_weight), 0.6, 1e-12);
  EXPECT_LT((Marginal(leaves) - before).norm(), 1e-12);
}

TEST(LeafReduction, LeavesOfOneAssignmentStayApartWhereTheirPosesDo) {
  const Eigen::Vector3d p(0.5, 0.25, 0.25);
  Leaf elsewhere = MakeLeaf(0.3, 1, p);
  const PoseWithCovariance far_off{Se2(4.0, 0.0, 0.0), Eigen::Matrix3d::Identity()};
  elsewhere.filter = KnownMapFilter(far_off, {});
  LeafSet<Leaf> leaves = SetOf({MakeLeaf(0.4, 1, p), MakeLeaf(0.3, 1, p), elsewhere});
  MergeLeaves({true}, &leaves);
  ASSERT_EQ(leaves.size(), 2u);
  EXPECT_NEAR(std::exp(leaves[0].log_weight), 0.7, 1e-12);
  EXPECT_EQ(leaves[1].filter.T_map_vehicle().x(), 4.0);
}

TEST(LeafReduction, ExcludingIsBayes) {
  LeafSet<Leaf> leaves = SetOf({MakeLeaf(0.6, 1, {0.5, 0.25, 0.25}),
                                MakeLeaf(0.4, GroupBelief::kUnresolved, {0.5, 0.3, 0.2})});
  Exclude(0, 1, &leaves);
  ASSERT_EQ(leaves.size(), 1u);
  EXPECT_NEAR(NormalizeWeights(&leaves), std::log(0.4 * 0.7), 1e-12);
  EXPECT_NEAR(leaves[0].beliefs[0].log_p[0], std::log(0.5 / 0.7), 1e-12);
}

TEST(LeafReduction, ReportsWhatTheBoundDropped) {
  LeafSet<Leaf> leaves = SetOf({MakeLeaf(0.2, 0, {0.5, 0.3, 0.2}),
                                MakeLeaf(0.7, 1, {0.5, 0.3, 0.2}),
                                MakeLeaf(0.1, 2, {0.5, 0.3, 0.2})});
  EXPECT_NEAR(KeepHeaviest(2, 1e-6, &leaves), 0.1, 1e-12);
  ASSERT_EQ(leaves.size(), 2u);
  EXPECT_EQ(leaves[0].beliefs[0].resolved, 1);
}

TEST(SequentialTest, OddsAreFiniteWhereAllOthersWereGivenUp) {
  const double threshold = DecisionThreshold(1e-4);
  const double gone = -std::numeric_limits<double>::infinity();
  const TestOutcome outcome = TestStates(Eigen::Vector3d(gone, -2.0, gone), threshold);
  EXPECT_EQ(outcome.decided, 1);
  EXPECT_TRUE(std::isfinite(outcome.log_odds));
  EXPECT_GT(outcome.log_odds, threshold);
}

TEST(Visit, EvidenceLeavesThePriorOut) {
  LandmarkGroup group;
  group.modes.resize(2);
  group.modes[0].number = ModeNumber(3);
  group.modes[1].number = ModeNumber(7);
  const Eigen::Vector3d log_likelihood(-4.0, -1.0, -80.0);
  for (const Eigen::Vector3d& prior :
       {Eigen::Vector3d(0.1, 0.6, 0.3), Eigen::Vector3d(0.8, 0.1, 0.1)}) {
    Visit visit;
    visit.given_up.resize(3);
    StateValues log_alive;
    for (Eigen::Index i = 0; i < prior.size(); ++i) {
      visit.log_prior.push_back(std::log(prior[i]));
      log_alive.push_back(visit.log_prior.back() + log_likelihood[i]);
    }
    const VisitEvidence evidence = EvidenceOf(visit, LogPosterior(visit, log_alive), group);
    ASSERT_EQ(evidence.modes.size(), 3u);
    EXPECT_EQ(evidence.modes[0].mode, kAbsent);
    EXPECT_EQ(evidence.modes[2].mode, ModeNumber(7));
    EXPECT_NEAR(evidence.modes[0].log_likelihood, -3.0, 1e-9);
    EXPECT_NEAR(evidence.modes[1].log_likelihood, 0.0, 1e-9);
    EXPECT_EQ(evidence.modes[2].log_likelihood, -50.0);
  }
}

}  // namespace
}  // namespace shiftmap
