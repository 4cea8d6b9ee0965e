// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_chain.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>

#include "mapper/chain/chain_expectations.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

using ::testing::HasSubstr;

constexpr double kDay = 86400.0;

// The long form: SHIFTMAP_LONG_TESTS=1.
int Trials(int normally) {
  return std::getenv("SHIFTMAP_LONG_TESTS") != nullptr ? 20 * normally : normally;
}

std::vector<Stamp> Every(double seconds, double total) {
  std::vector<Stamp> stamps;
  for (double now = 0.0; now <= total; now += seconds) stamps.push_back(StampFromSeconds(now));
  return stamps;
}

// Gaps from seconds to days, all decades alike.
std::vector<Stamp> AtRandom(double total, std::mt19937_64& random) {
  std::uniform_real_distribution<double> decade(1.0, 5.2);
  std::vector<Stamp> stamps;
  for (double now = 0.0; now <= total; now += std::pow(10.0, decade(random))) {
    stamps.push_back(StampFromSeconds(now));
  }
  return stamps;
}

ModeChain TwoStates(double from_0, double from_1) {
  Eigen::MatrixXd rates(2, 2);
  rates << -from_0, from_0, from_1, -from_1;
  return *ModeChain::FromRates(rates);
}

TEST(LearnChainTest, RatesDoNotDependOnHowVisitsAreSpaced) {
  std::mt19937_64 random(TestSeed(41));
  const ModeChain truth = TwoStates(0.25 / kDay, 0.5 / kDay);
  const double total = 400.0 * kDay;
  const ChainPath path =
      SimulateChain(truth, 0, StampFromSeconds(0.0), StampFromSeconds(total), random);
  ChainLearningOptions options;
  options.structure = ChainStructure::kGeneral;
  options.interval = 0.99;
  for (const std::vector<Stamp>& stamps :
       {Every(60.0, total), Every(kDay, total), AtRandom(total, random)}) {
    const StatusOr<LearnedChain> learned =
        LearnChain(ObservePath(path, 2, stamps, 0.01, random), options);
    ASSERT_TRUE(learned.ok());
    for (int from = 0; from < 2; ++from) {
      const double rate = truth.rate_matrix()(from, 1 - from);
      EXPECT_LT(learned->low(from, 1 - from), rate) << stamps.size() << " visits";
      EXPECT_GT(learned->high(from, 1 - from), rate) << stamps.size() << " visits";
      // An interval that holds everything would prove nothing.
      EXPECT_LT(learned->high(from, 1 - from), 2.5 * learned->low(from, 1 - from));
    }
  }
}

// The prior's mean is a jump in a day: a thing that moves every other minute, and from some states
// that it is hardly ever in.
TEST(LearnChainTest, RatesFarFromThePriorAreFound) {
  std::mt19937_64 random(TestSeed(45));
  Eigen::MatrixXd rates(4, 4);
  rates << -20.2, 10.0, 10.0, 0.2, 30.0, -50.0, 20.0, 0.0, 5.0, 95.0, -100.0, 0.0, 500.0, 300.0,
      200.0, -1000.0;
  const ModeChain truth = *ModeChain::FromRates(rates / kDay);
  const std::vector<Stamp> stamps = Every(60.0, 40.0 * kDay);
  const ChainPath path = SimulateChain(truth, 0, stamps.front(), stamps.back(), random);
  ChainLearningOptions options;
  options.interval = 0.999;
  const StatusOr<LearnedChain> learned =
      LearnChain(ObservePath(path, 4, stamps, 1e-6, random), options);
  ASSERT_TRUE(learned.ok());
  EXPECT_FALSE(learned->chain.uniform());
  for (int from = 0; from < 4; ++from) {
    for (int to = 0; to < 4; ++to) {
      if (from == to || truth.rate_matrix()(from, to) == 0.0) continue;
      EXPECT_LT(learned->low(from, to), truth.rate_matrix()(from, to)) << from << " to " << to;
      EXPECT_GT(learned->high(from, to), truth.rate_matrix()(from, to)) << from << " to " << to;
    }
  }
  EXPECT_LT(learned->leave.low_per_s, truth.leave_rate_per_s());
  EXPECT_GT(learned->leave.high_per_s, truth.leave_rate_per_s());
}

// How often 95 % intervals hold the truth.
struct Coverage {
  int held = 0;
  int count = 0;
};

Coverage CoverageOf(const ModeChain& truth,
                    ChainStructure structure,
                    bool random_gaps,
                    int trials,
                    std::mt19937_64& random) {
  ChainLearningOptions options;
  options.structure = structure;
  options.gap_resolution = 0.02;
  Coverage coverage;
  const double total = 120.0 * kDay;
  for (int trial = 0; trial < trials; ++trial) {
    const ChainPath path = SimulateChain(
        truth, trial % truth.states(), StampFromSeconds(0.0), StampFromSeconds(total), random);
    const std::vector<Stamp> stamps =
        random_gaps ? AtRandom(total, random) : Every(0.5 * kDay, total);
    const StatusOr<LearnedChain> learned =
        LearnChain(ObservePath(path, truth.states(), stamps, 0.02, random), options);
    EXPECT_TRUE(learned.ok());
    if (structure == ChainStructure::kUniform) {
      ++coverage.count;
      const double rate = truth.leave_rate_per_s();
      if (learned->leave.low_per_s <= rate && rate <= learned->leave.high_per_s) ++coverage.held;
      continue;
    }
    for (int from = 0; from < truth.states(); ++from) {
      for (int to = 0; to < truth.states(); ++to) {
        if (from == to) continue;
        ++coverage.count;
        const double rate = truth.rate_matrix()(from, to);
        if (learned->low(from, to) <= rate && rate <= learned->high(from, to)) ++coverage.held;
      }
    }
  }
  return coverage;
}

TEST(LearnChainTest, IntervalsHoldTheTruthAsOftenAsTheySay) {
  std::mt19937_64 random(TestSeed(42));
  Eigen::MatrixXd rates(3, 3);
  rates << -0.3, 0.1, 0.2, 0.4, -0.5, 0.1, 0.2, 0.2, -0.4;
  const ModeChain general = *ModeChain::FromRates(rates / kDay);
  const ModeChain uniform = ModeChain::Uniform(2, 0.3 / kDay);
  for (const bool random_gaps : {false, true}) {
    for (const ChainStructure structure : {ChainStructure::kUniform, ChainStructure::kGeneral}) {
      const bool is_uniform = structure == ChainStructure::kUniform;
      const Coverage coverage = CoverageOf(is_uniform ? uniform : general,
                                           structure,
                                           random_gaps,
                                           Trials(is_uniform ? 60 : 15),
                                           random);
      const double share = static_cast<double>(coverage.held) / coverage.count;
      const double sd = std::sqrt(0.95 * 0.05 / coverage.count);
      RecordProperty(std::string(is_uniform ? "uniform" : "general") +
                         (random_gaps ? "_random_gaps" : "_even_gaps"),
                     std::to_string(share));
      EXPECT_NEAR(share, 0.95, 3.5 * sd + 0.01) << (is_uniform ? "uniform" : "general")
                                                << (random_gaps ? ", random gaps" : ", even gaps");
    }
  }
}

TEST(LearnChainTest, TakesTheStructureThatGeneratedTheHistory) {
  std::mt19937_64 random(TestSeed(43));
  const std::vector<Stamp> stamps = Every(3600.0, 300.0 * kDay);
  Eigen::MatrixXd rates(3, 3);
  rates << -0.3, 0.3, 0.0, 0.1, -1.1, 1.0, 2.0, 0.0, -2.0;
  const ModeChain general = *ModeChain::FromRates(rates / kDay);
  const ModeChain uniform = ModeChain::Uniform(2, 0.5 / kDay);
  for (const ModeChain& truth : {general, uniform}) {
    const ChainPath path = SimulateChain(truth, 0, stamps.front(), stamps.back(), random);
    const StatusOr<LearnedChain> learned =
        LearnChain(ObservePath(path, 3, stamps, 0.01, random), {});
    ASSERT_TRUE(learned.ok());
    EXPECT_EQ(learned->fit.structure == ChainStructure::kUniform, truth.uniform());
    EXPECT_NEAR(learned->general, truth.uniform() ? 0.0 : 1.0, 0.01);
  }
}

// Each stay in mode 2 lasts longer and longer: one rate for all pairs becomes less probable, and
// the rates of both structures differ where the more probable one changes.
TEST(LearnChainTest, RatesDoNotJumpWhereTheStructureChanges) {
  constexpr int kSteps = 200;
  double fit_jump = 0.0;
  double mean_jump = 0.0;
  std::optional<LearnedChain> before;
  for (int step = 0; step <= kSteps; ++step) {
    ChainHistory history{Signature("7"), 3, {}};
    double now = 1.7e9;
    for (const int state : {0, 1, 2, 0, 2, 1, 0, 1, 2, 0, 2, 1, 0}) {
      for (int visit = 0; visit < 4; ++visit) {
        Eigen::VectorXd evidence = Eigen::VectorXd::Constant(3, -10.0);
        evidence(state) = 0.0;
        history.visits.push_back({StampFromSeconds(now), StampFromSeconds(now), evidence});
        now += 0.2 * kDay * (state == 2 ? 1.0 + 19.0 * step / kSteps : 1.0);
      }
    }
    const StatusOr<LearnedChain> learned = LearnChain(history, {});
    ASSERT_TRUE(learned.ok());
    if (before) {
      const auto jump = [](const ModeChain& a, const ModeChain& b) {
        return std::abs(std::log(a.leave_rate_per_s() / b.leave_rate_per_s()));
      };
      fit_jump = std::max(fit_jump, jump(before->fit.chain, learned->fit.chain));
      mean_jump = std::max(mean_jump, jump(before->chain, learned->chain));
    }
    before = *learned;
  }
  EXPECT_GT(fit_jump, 0.2);
  EXPECT_LT(mean_jump, 0.03);
}

// Rates from the prior, one rate or a rate for each pair, and few visits: the mean of both
// structures predicts the visits that follow better than the more probable one.
TEST(LearnChainTest, TheMeanOfTheStructuresPredictsBetterThanTheMoreProbableOne) {
  std::mt19937_64 random(TestSeed(46));
  ChainLearningOptions options;
  options.share_prior = false;
  constexpr std::size_t kSeen = 12;
  const std::vector<Stamp> stamps = Every(0.4 * kDay, 0.4 * kDay * 2 * kSeen);
  std::gamma_distribution<double> rate(options.prior.shape, 1.0 / options.prior.exposure_s);
  double gain = 0.0;
  for (int trial = 0; trial < Trials(400); ++trial) {
    Eigen::Matrix3d rates = Eigen::Matrix3d::Constant(0.5 * rate(random));
    if (trial % 2 == 0) rates = rates.unaryExpr([&](double) { return 0.5 * rate(random); }).eval();
    rates.diagonal().setZero();
    rates.diagonal() = -rates.rowwise().sum();
    const ModeChain truth = *ModeChain::FromRates(rates);
    const ChainPath path = SimulateChain(truth, trial % 3, stamps.front(), stamps.back(), random);
    const ChainHistory whole = ObservePath(path, 3, stamps, 0.01, random);
    ChainHistory seen = whole;
    seen.visits.resize(kSeen);
    const StatusOr<LearnedChain> learned = LearnChain(seen, options);
    ASSERT_TRUE(learned.ok());
    gain += PredictiveLogLikelihood(whole, kSeen, {learned->chain}) -
            PredictiveLogLikelihood(whole, kSeen, {learned->fit.chain});
  }
  RecordProperty("gain_nat", std::to_string(gain));
  EXPECT_GT(gain, 0.0);
}

// Modes are never deleted: an old landmark has many. 870 rates would take minutes, and 300 visits
// do not tell them.
TEST(LearnChainTest, ManyStatesAreFittedByOneRate) {
  std::mt19937_64 random(TestSeed(44));
  const std::vector<Stamp> stamps = Every(0.25 * kDay, 75.0 * kDay);
  const ModeChain truth = ModeChain::Uniform(29, 0.5 / kDay);
  const ChainPath path = SimulateChain(truth, 1, stamps.front(), stamps.back(), random);
  const StatusOr<LearnedChain> learned =
      LearnChain(ObservePath(path, 30, stamps, 1e-3, random), {});
  ASSERT_TRUE(learned.ok());
  EXPECT_TRUE(learned->chain.uniform());
  EXPECT_EQ(learned->general, 0.0);
  EXPECT_LT(learned->leave.low_per_s, 0.5 / kDay);
  EXPECT_GT(learned->leave.high_per_s, 0.5 / kDay);
}

TEST(LearnChainTest, GroupsHardlySeenGetTheRatesOfTheOthers) {
  std::mt19937_64 random(TestSeed(44));
  const Gamma truth{2.0, 2.0 * 10.0 * kDay};  // A jump in ten days, a factor of two either way.
  std::vector<ChainHistory> histories;
  std::vector<double> rates;
  for (int group = 0; group < 40; ++group) {
    rates.push_back(std::gamma_distribution<double>(truth.shape, 1.0 / truth.exposure_s)(random));
    const std::vector<Stamp> stamps = Every(kDay, (group % 2 == 0 ? 90.0 : 3.0) * kDay);
    const ChainPath path = SimulateChain(
        ModeChain::Uniform(2, rates.back()), 0, stamps.front(), stamps.back(), random);
    histories.push_back(ObservePath(path, 3, stamps, 0.01, random));
  }
  ChainLearningOptions options;
  options.structure = ChainStructure::kUniform;
  const StatusOr<LearnedChains> shared = LearnChains(histories, options);
  options.share_prior = false;
  const StatusOr<LearnedChains> alone = LearnChains(histories, options);
  ASSERT_TRUE(shared.ok() && alone.ok());
  EXPECT_NEAR(std::log(shared->prior.mean() / truth.mean()), 0.0, std::log(1.5));
  double shared_error = 0.0;
  double alone_error = 0.0;
  int held = 0;
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const RateInterval& leave = shared->chains[i].leave;
    shared_error += std::pow(std::log(leave.rate_per_s / rates[i]), 2);
    alone_error += std::pow(std::log(alone->chains[i].leave.rate_per_s / rates[i]), 2);
    if (leave.low_per_s <= rates[i] && rates[i] <= leave.high_per_s) ++held;
  }
  EXPECT_LT(shared_error, 0.7 * alone_error);
  EXPECT_GE(held, 31);
}

TEST(LearnChainTest, AGroupWithoutModesHasNothingToLearn) {
  const StatusOr<LearnedChain> learned = LearnChain({Signature("7"), 1, {}}, {});
  ASSERT_TRUE(learned.ok());
  EXPECT_EQ(learned->chain.states(), 1);
  EXPECT_EQ(learned->leave.rate_per_s, 0.0);
}

TEST(LearnChainTest, AGroupNeverSeenGetsThePrior) {
  const StatusOr<LearnedChain> learned = LearnChain({Signature("7"), 3, {}}, {});
  ASSERT_TRUE(learned.ok());
  EXPECT_NEAR(learned->leave.rate_per_s, 1e-5, 1e-9);
  EXPECT_LT(learned->leave.low_per_s, 2e-7);
  EXPECT_EQ(learned->visits, 0);
}

TEST(LearnChainTest, RefusesBadInput) {
  ChainHistory history{Signature("7"), 2, {}};
  history.visits.push_back({StampFromSeconds(2.0), StampFromSeconds(1.0), Eigen::Vector2d::Zero()});
  EXPECT_THAT(Message(LearnChain(history, {}).status()), HasSubstr("visit 0 out of order"));
  ChainLearningOptions options;
  options.interval = 1.0;
  EXPECT_THAT(Message(LearnChain({Signature("7"), 2, {}}, options).status()),
              HasSubstr("interval 1, expected within (0, 1)"));
}

}  // namespace
}  // namespace shiftmap::testing
