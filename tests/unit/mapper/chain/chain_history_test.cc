// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_history.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

Stamp At(double seconds) { return StampFromSeconds(seconds); }

TEST(ChainHistoryTest, RowsInTheOrderOfTimeEachOnce) {
  std::mt19937_64 random(TestSeed(11));
  const LandmarkGroup group = RandomGroup(random, "7", 2);
  std::vector<EvidenceRow> rows;
  for (int i = 0; i < 20; ++i) {
    rows.push_back({"r", RandomEvidence(random, group, At(100.0 * i), At(100.0 * i + 5.0))});
  }
  const ChainHistory expected = MakeChainHistory(group, rows);
  EXPECT_EQ(expected.states, 3);
  rows.insert(rows.end(), rows.begin(), rows.begin() + 7);
  std::shuffle(rows.begin(), rows.end(), random);
  const ChainHistory history = MakeChainHistory(group, rows);
  EXPECT_TRUE(CheckHistory(history).ok());
  ASSERT_EQ(history.visits.size(), expected.visits.size());
  for (std::size_t i = 0; i < history.visits.size(); ++i) {
    EXPECT_EQ(history.visits[i].begin, expected.visits[i].begin);
    EXPECT_EQ(history.visits[i].log_likelihoods, expected.visits[i].log_likelihoods);
  }
}

// The mixture by its formula, and what follows: a visit rules nothing out.
TEST(ChainHistoryTest, MistakesBoundWhatAVisitSays) {
  ChainHistory history{Signature("7"), 3, {}};
  history.visits.push_back({At(0.0), At(1.0), Eigen::Vector3d(-1.0, -2.0, -4.0)});
  history.visits.push_back({At(2.0), At(3.0), Eigen::Vector3d(-2000.0, 0.0, -1.0)});
  const ChainHistory same = AllowMistakes(history, 0.0);
  EXPECT_EQ(same.visits[1].log_likelihoods, history.visits[1].log_likelihoods);
  const ChainHistory mixed = AllowMistakes(history, 0.03);
  const double sum = std::exp(-1.0) + std::exp(-2.0) + std::exp(-4.0);
  for (int state = 0; state < 3; ++state) {
    EXPECT_NEAR(std::exp(mixed.visits[0].log_likelihoods[state]),
                0.97 * std::exp(history.visits[0].log_likelihoods[state]) / sum + 0.01,
                1e-14);
  }
  EXPECT_NEAR(std::exp(mixed.visits[1].log_likelihoods[0]), 0.01, 1e-14);
}

TEST(ChainHistoryTest, VisitsThatOverlapAreOne) {
  std::mt19937_64 random(TestSeed(12));
  const LandmarkGroup group = RandomGroup(random, "7", 2);
  const VisitEvidence first = RandomEvidence(random, group, At(0.0), At(10.0));
  const VisitEvidence inside = RandomEvidence(random, group, At(2.0), At(4.0));
  const VisitEvidence touching = RandomEvidence(random, group, At(10.0), At(12.0));
  const VisitEvidence later = RandomEvidence(random, group, At(13.0), At(14.0));
  const ChainHistory history =
      MakeChainHistory(group, {{"a", first}, {"b", inside}, {"c", touching}, {"d", later}});
  ASSERT_EQ(history.visits.size(), 2u);
  EXPECT_EQ(history.visits[0].end, At(12.0));
  Eigen::VectorXd sum = Eigen::VectorXd::Zero(3);
  for (const VisitEvidence* visit : {&first, &inside, &touching}) {
    Eigen::VectorXd values;
    StateLogLikelihoods(group, visit->modes, &values);
    sum += values;
  }
  EXPECT_THAT(history.visits[0].log_likelihoods, IsNearMatrix(sum, 1e-12));
}

TEST(ChainHistoryTest, LeavesOutWhatFavoursAnUnknownMode) {
  std::mt19937_64 random(TestSeed(13));
  const LandmarkGroup group = RandomGroup(random, "7", 2);
  VisitEvidence evidence = RandomEvidence(random, group, At(0.0), At(1.0));
  evidence.modes.push_back({ModeNumber(99), 1e6});
  EXPECT_TRUE(MakeChainHistory(group, {{"a", evidence}}).visits.empty());
}

TEST(ChainHistoryTest, CheckNamesTheVisit) {
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(2);
  ChainHistory history{Signature("7"), 2, {{At(0.0), At(1.0), zero}, {At(2.0), At(3.0), zero}}};
  EXPECT_TRUE(CheckHistory(history).ok());
  history.visits[1].begin = At(1.0);
  EXPECT_THAT(Message(CheckHistory(history)), HasSubstr("'7': visit 1 out of order"));
  history.visits[1].begin = At(2.0);
  history.visits[0].log_likelihoods = Eigen::VectorXd::Zero(3);
  EXPECT_THAT(Message(CheckHistory(history)),
              HasSubstr("visit 0 has 3 log-likelihoods, expected 2"));
  history.visits[0].log_likelihoods = zero;
  history.visits[1].log_likelihoods(1) = -std::numeric_limits<double>::infinity();
  EXPECT_THAT(Message(CheckHistory(history)),
              HasSubstr("visit 1 has a log-likelihood that is not"));
}

}  // namespace
}  // namespace shiftmap::testing
