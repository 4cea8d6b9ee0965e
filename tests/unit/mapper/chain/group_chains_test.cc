// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/group_chains.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kDay = 86400.0;

std::vector<LandmarkGroup> Groups(int count, int modes, std::mt19937_64& random) {
  std::vector<LandmarkGroup> groups;
  for (int i = 0; i < count; ++i) {
    groups.push_back(RandomGroup(random, fmt::format("{:03}", i), modes));
  }
  return groups;
}

// Reports of what was seen of a group at the given times.
void AddRows(const LandmarkGroup& group,
             const ModeChain& truth,
             const std::vector<Stamp>& stamps,
             double wrong,
             std::mt19937_64& random,
             std::vector<EvidenceRow>* rows) {
  const ChainPath path = SimulateChain(truth, 1, stamps.front(), stamps.back(), random);
  const ChainHistory history = ObservePath(path, truth.states(), stamps, wrong, random);
  for (const ChainVisit& visit : history.visits) {
    EvidenceRow row{"report", {group.signature, visit.begin, visit.end, {}}};
    for (int state = 0; state < truth.states(); ++state) {
      row.evidence.modes.push_back({group.NumberOf(state), visit.log_likelihoods[state]});
    }
    rows->push_back(std::move(row));
  }
}

std::vector<Stamp> Every(double seconds, int count) {
  std::vector<Stamp> stamps;
  for (int i = 0; i < count; ++i) stamps.push_back(StampFromSeconds(1.7e9 + seconds * i));
  return stamps;
}

// A fifth of the visits is of a vehicle that says each time that the landmark is elsewhere.
TEST(GroupChainsTest, AVehicleThatContradictsTheOthersTeachesNoMoves) {
  std::mt19937_64 random(TestSeed(73));
  const std::vector<LandmarkGroup> groups = Groups(20, 2, random);
  const ModeChain truth = ModeChain::Uniform(2, 0.1 / kDay);
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    AddRows(group, truth, Every(0.2 * kDay, 200), 1e-6, random, &rows);
  }
  std::vector<EvidenceRow> honest;
  std::vector<EvidenceRow> all;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    EvidenceRow row = rows[i];
    row.vehicle = fmt::format("vehicle-{}", i % 5);
    if (i % 5 != 0) {
      honest.push_back(row);
    } else {
      std::rotate(
          row.evidence.modes.begin(), row.evidence.modes.begin() + 1, row.evidence.modes.end());
      for (int state = 0; state < truth.states(); ++state) {
        row.evidence.modes[static_cast<std::size_t>(state)].mode = groups.front().NumberOf(state);
      }
    }
    all.push_back(std::move(row));
  }
  const auto mean_rate = [&](const std::vector<EvidenceRow>& evidence) {
    const auto chains = LearnGroupChains(groups, evidence, {});
    double sum = 0.0;
    for (const GroupChain& chain : *chains) sum += chain.chain.chain.leave_rate_per_s();
    return sum / static_cast<double>(groups.size());
  };
  EXPECT_NEAR(mean_rate(all), mean_rate(honest), 0.1 * mean_rate(honest));
}

TEST(GroupChainsTest, RatesOfALedgerHoldTheTruth) {
  std::mt19937_64 random(TestSeed(71));
  const std::vector<LandmarkGroup> groups = Groups(20, 2, random);
  const ModeChain truth = ModeChain::Uniform(2, 0.5 / kDay);
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    AddRows(group, truth, Every(0.25 * kDay, 300), 0.01, random, &rows);
  }
  const auto chains = LearnGroupChains(groups, rows, {});
  ASSERT_TRUE(chains.ok());
  int held = 0;
  double mean_log = 0.0;
  for (const GroupChain& group : *chains) {
    EXPECT_TRUE(group.learned);
    const RateInterval& leave = group.chain.leave;
    held += leave.low_per_s < 0.5 / kDay && 0.5 / kDay < leave.high_per_s;
    mean_log += std::log(leave.rate_per_s) / 20.0;
  }
  EXPECT_GE(held, 17);
  EXPECT_NEAR(mean_log, std::log(0.5 / kDay), 0.15);
}

// One door that opens by day, and landmarks that move at any hour.
TEST(GroupChainsTest, AChainGetsARhythmWhereItsVisitsSupportIt) {
  std::mt19937_64 random(TestSeed(75));
  const std::vector<LandmarkGroup> groups = Groups(4, 1, random);
  const std::vector<Stamp> stamps = Every(1800.0, 30 * 48);
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    AddRows(group, ModeChain::Uniform(1, 4.0 / kDay), stamps, 1e-6, random, &rows);
  }
  const auto is_open = [](Stamp stamp) {
    const double of_day = std::fmod(ToSecondsSinceEpoch(stamp), kDay);
    return of_day > 0.3 * kDay && of_day < 0.6 * kDay;
  };
  for (EvidenceRow& row : rows) {
    if (row.evidence.signature != groups[0].signature) continue;
    const bool open = is_open(row.evidence.begin) && random() % 10 != 0;
    row.evidence.modes[0].log_likelihood = open ? -20.0 : 0.0;
    row.evidence.modes[1].log_likelihood = open ? 0.0 : -20.0;
  }
  const auto chains = LearnGroupChains(groups, rows, {});
  ASSERT_TRUE(chains.ok());
  ASSERT_NE((*chains)[0].chain.chain.rhythm(), nullptr);
  EXPECT_GT((*chains)[0].rhythm_gain, 20.0);
  for (std::size_t i = 1; i < groups.size(); ++i) {
    EXPECT_EQ((*chains)[i].chain.chain.rhythm(), nullptr) << i;
    EXPECT_LT((*chains)[i].rhythm_gain, 3.0) << i;
  }
  GroupChainOptions options;
  options.learn_rhythms = false;
  const auto without = LearnGroupChains(groups, rows, options);
  ASSERT_TRUE(without.ok());
  EXPECT_EQ((*without)[0].chain.chain.rhythm(), nullptr);
  EXPECT_EQ((*without)[0].chain.chain.rate_matrix(), (*chains)[0].chain.chain.rate_matrix());
}

TEST(GroupChainsTest, OrderOfRowsAndRowsGivenTwiceChangeNothing) {
  std::mt19937_64 random(TestSeed(72));
  const std::vector<LandmarkGroup> groups = Groups(3, 2, random);
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    AddRows(group, ModeChain::Uniform(2, 1.0 / kDay), Every(3e4, 60), 0.02, random, &rows);
  }
  const auto expected = LearnGroupChains(groups, rows, {});
  rows.insert(rows.end(), rows.begin(), rows.begin() + 40);
  std::shuffle(rows.begin(), rows.end(), random);
  const auto chains = LearnGroupChains(groups, rows, {});
  ASSERT_TRUE(expected.ok() && chains.ok());
  for (std::size_t i = 0; i < groups.size(); ++i) {
    EXPECT_EQ((*chains)[i].chain.signature, groups[i].signature);
    EXPECT_EQ((*chains)[i].chain.chain.rate_matrix(), (*expected)[i].chain.chain.rate_matrix());
    EXPECT_EQ((*chains)[i].chain.leave.high_per_s, (*expected)[i].chain.leave.high_per_s);
  }
}

// Twenty minutes in which nothing moves say little of days; nor do a few visits in which something
// else was taken for the landmark.
TEST(GroupChainsTest, OneRunGivesNoExtremeRate) {
  std::mt19937_64 random(TestSeed(73));
  const std::vector<LandmarkGroup> groups = Groups(15, 1, random);
  for (const bool misread : {false, true}) {
    std::vector<EvidenceRow> rows;
    for (const LandmarkGroup& group : groups) {
      AddRows(group, ModeChain::Uniform(1, 0.0), Every(60.0, 20), 1e-9, random, &rows);
    }
    if (misread) {
      for (std::size_t i = 10; i < rows.size(); i += 60) {
        std::swap(rows[i].evidence.modes[0].log_likelihood,
                  rows[i].evidence.modes[1].log_likelihood);
      }
    }
    const GroupChainOptions options;
    const auto chains = LearnGroupChains(groups, rows, options);
    ASSERT_TRUE(chains.ok());
    for (const GroupChain& group : *chains) {
      EXPECT_GT(group.chain.leave.rate_per_s, 0.3 * options.leave_rate_per_s) << misread;
      EXPECT_LT(group.chain.leave.rate_per_s, 3.0 * options.leave_rate_per_s) << misread;
    }
  }
}

TEST(GroupChainsTest, WithoutEvidenceThePriorStays) {
  std::mt19937_64 random(TestSeed(74));
  const std::vector<LandmarkGroup> groups = Groups(3, 2, random);
  std::vector<EvidenceRow> rows;
  AddRows(groups[0], ModeChain::Uniform(2, 1.0 / kDay), Every(3e4, 1), 0.02, random, &rows);
  AddRows(RandomGroup(random, "other", 2),
          ModeChain::Uniform(2, 1.0 / kDay),
          Every(3e4, 50),
          0.02,
          random,
          &rows);
  GroupChainOptions options;
  options.leave_rate_per_s = 3e-6;
  const auto chains = LearnGroupChains(groups, rows, options);
  ASSERT_TRUE(chains.ok());
  const Gamma prior{options.prior_jumps, options.prior_jumps / options.leave_rate_per_s};
  for (const GroupChain& group : *chains) {
    EXPECT_FALSE(group.learned);
    EXPECT_TRUE(group.chain.chain.uniform());
    EXPECT_NEAR(group.chain.leave.rate_per_s, 3e-6, 1e-9);
    EXPECT_NEAR(group.chain.leave.high_per_s, prior.Quantile(0.975), 1e-2 * prior.Quantile(0.975));
  }
}

// The mode of a Gamma density of log x is (shape / exposure), whoever counts.
TEST(GroupChainsTest, AStatedRateCountsAsJumpsInATime) {
  std::mt19937_64 random(TestSeed(76));
  const std::vector<LandmarkGroup> groups = Groups(2, 2, random);
  GroupChainOptions options;
  options.leave_rate_per_s = 3e-6;
  options.stated[groups[0].signature] = {4.0, 4.0 / 1e-3};
  const auto chains = LearnGroupChains(groups, {}, options);
  ASSERT_TRUE(chains.ok());
  const double jumps = options.prior_jumps + 4.0;
  const double seconds = options.prior_jumps / options.leave_rate_per_s + 4.0 / 1e-3;
  EXPECT_NEAR((*chains)[0].chain.leave.rate_per_s, jumps / seconds, 1e-9);
  EXPECT_NEAR((*chains)[1].chain.leave.rate_per_s, 3e-6, 1e-9);

  // Against visits that never find it moved, where a heavy statement wins and a light one does not.
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    AddRows(group, ModeChain::Uniform(2, 0.0), Every(3e4, 40), 1e-6, random, &rows);
  }
  const auto learned = [&](double weight) {
    options.stated[groups[0].signature] = {weight, weight / 1e-3};
    return LearnGroupChains(groups, rows, options)->front().chain.leave.rate_per_s;
  };
  EXPECT_GT(learned(1e5), 0.9e-3);
  EXPECT_LT(learned(0.1), 2e-5);
  options.stated[groups[0].signature] = {1.0, 0.0};
  EXPECT_THAT(Message(LearnGroupChains(groups, rows, options).status()),
              HasSubstr("1 jumps in 0 s stated, expected > 0"));
}

// Years of irregular visits: bounded work, and the rates all the same.
TEST(GroupChainsTest, LongIrregularLedgersAreLearnedFromToo) {
  std::mt19937_64 random(TestSeed(75));
  const std::vector<LandmarkGroup> groups = Groups(3, 2, random);
  std::uniform_real_distribution<double> decade(1.5, 5.0);
  Eigen::MatrixXd rates(3, 3);
  rates << -0.6, 0.4, 0.2, 0.1, -0.3, 0.2, 0.4, 0.5, -0.9;
  const ModeChain truth = *ModeChain::FromRates(rates / kDay);
  std::vector<EvidenceRow> rows;
  for (const LandmarkGroup& group : groups) {
    std::vector<Stamp> stamps = {StampFromSeconds(1.7e9)};
    while (stamps.size() < 3000) {
      stamps.push_back(stamps.back() + FromSeconds(std::pow(10.0, decade(random))));
    }
    AddRows(group, truth, stamps, 0.01, random, &rows);
  }
  const auto chains = LearnGroupChains(groups, rows, {});
  ASSERT_TRUE(chains.ok());
  for (const GroupChain& group : *chains) {
    EXPECT_FALSE(group.chain.chain.uniform());
    EXPECT_LT(group.chain.leave.low_per_s, truth.leave_rate_per_s());
    EXPECT_GT(group.chain.leave.high_per_s, truth.leave_rate_per_s());
  }
}

TEST(GroupChainsTest, RefusesOptionsOutOfRange) {
  GroupChainOptions options;
  options.leave_rate_per_s = 0.0;
  EXPECT_THAT(Message(LearnGroupChains({}, {}, options).status()),
              HasSubstr("leave rate 0 per s, expected > 0"));
  options = {};
  options.mistaken_visits = 1.0;
  EXPECT_THAT(Message(LearnGroupChains({}, {}, options).status()),
              HasSubstr("1 mistaken visits, expected within [0, 1)"));
}

}  // namespace
}  // namespace shiftmap::testing
