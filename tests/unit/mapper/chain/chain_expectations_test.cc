// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/chain_expectations.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>
#include <vector>

#include "mapper/chain/gap_integral.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

ModeChain RandomChain(std::mt19937_64& random, int states, double scale) {
  std::uniform_real_distribution<double> uniform(0.1, 1.0);
  Eigen::MatrixXd rates(states, states);
  for (double& rate : rates.reshaped()) rate = scale * uniform(random);
  rates.diagonal().setZero();
  rates.diagonal() = -rates.rowwise().sum();
  return *ModeChain::FromRates(rates);
}

ChainHistory RandomHistory(std::mt19937_64& random, int states, int visits) {
  std::uniform_real_distribution<double> gap(1.0, 90'000.0);
  std::normal_distribution<double> value(0.0, 2.0);
  ChainHistory history{Signature("x"), states, {}};
  Stamp now = StampFromSeconds(1.7e9);
  for (int i = 0; i < visits; ++i) {
    now += FromSeconds(gap(random));
    const Stamp begin = now;
    now += FromSeconds(10.0);
    Eigen::VectorXd values(states);
    for (double& entry : values) entry = value(random);
    history.visits.push_back({begin, now, values});
  }
  return history;
}

TEST(ChainExpectationsTest, GapIntegralIsTheIntegral) {
  std::mt19937_64 random(TestSeed(1));
  for (const double length : {0.01, 1.0, 30.0}) {
    const ModeChain chain = RandomChain(random, 4, 0.3);
    const Eigen::MatrixXd weights = 1e9 * Eigen::MatrixXd::Random(4, 4).cwiseAbs();
    // Simpson's rule.
    constexpr int kPieces = 2000;
    Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(4, 4);
    for (int i = 0; i <= kPieces; ++i) {
      const double s = length * i / kPieces;
      const double factor = i == 0 || i == kPieces ? 1.0 : i % 2 == 1 ? 4.0 : 2.0;
      sum += factor * chain.Transition(FromSeconds(s)).transpose() * weights *
             chain.Transition(FromSeconds(length - s)).transpose();
    }
    sum *= length / kPieces / 3.0;
    EXPECT_THAT(Eigen::MatrixXd(GapIntegral(chain.rate_matrix(), length, weights) / sum.maxCoeff()),
                IsNearMatrix(Eigen::MatrixXd(sum / sum.maxCoeff()), 1e-8))
        << length << " s";
  }
}

// A chain that is uniform but for what no integral shows.
TEST(ChainExpectationsTest, TheClosedFormOfAUniformChainIsThatOfTheBlock) {
  for (const int states : {2, 3, 5}) {
    const ModeChain uniform = ModeChain::Uniform(states - 1, 1e-4);
    Eigen::MatrixXd rates = uniform.rate_matrix();
    rates(0, 1) *= 1.0 + 1e-9;
    rates(0, 0) -= 1e-9 * rates(0, 1);
    const ModeChain general = *ModeChain::FromRates(rates);
    ASSERT_FALSE(general.uniform());
    const Eigen::MatrixXd weights = Eigen::MatrixXd::Random(states, states).cwiseAbs();
    for (const double length : {1e-3, 10.0, 1e4, 1e6}) {
      EXPECT_THAT(
          Eigen::MatrixXd(GapIntegral(uniform.rate_matrix(), length, weights) / length),
          IsNearMatrix(
              Eigen::MatrixXd(GapIntegral(general.rate_matrix(), length, weights) / length), 1e-7))
          << states << " states, " << length << " s";
    }
  }
}

TEST(ChainExpectationsTest, GapsOfYearsStayExact) {
  std::mt19937_64 random(TestSeed(2));
  const ModeChain chain = RandomChain(random, 3, 10.0);
  const Duration years = FromSeconds(1e8);
  const Eigen::VectorXd start = RandomDistribution(random, 3);
  // All that is known is the start: the time in all states together is the time.
  const Eigen::MatrixXd integral =
      GapIntegral(chain.rate_matrix(), ToSeconds(years), start * Eigen::RowVectorXd::Ones(3));
  EXPECT_NEAR(integral.trace() / 1e8, 1.0, 1e-12);
  const Eigen::VectorXd stationary = chain.Transition(years).row(0);
  EXPECT_THAT(Eigen::VectorXd(integral.diagonal() / 1e8), IsNearMatrix(stationary, 1e-7));
}

// Sums over all sequences of states.
double BruteForce(const ChainHistory& history, const ModeChain& chain) {
  const int n = history.states;
  const std::size_t count = history.visits.size();
  double total = 0.0;
  for (int code = 0; code < std::pow(n, count); ++code) {
    double probability = 1.0 / n;
    int rest = code;
    int before = 0;
    for (std::size_t i = 0; i < count; ++i) {
      const int state = rest % n;
      rest /= n;
      if (i > 0) {
        const Duration gap = history.visits[i].begin - history.visits[i - 1].end;
        probability *= chain.Transition(gap)(before, state);
      }
      probability *= std::exp(history.visits[i].log_likelihoods(state));
      before = state;
    }
    total += probability;
  }
  return std::log(total);
}

TEST(ChainExpectationsTest, LogLikelihoodSumsOverAllSequences) {
  std::mt19937_64 random(TestSeed(3));
  const ChainHistory history = RandomHistory(random, 3, 6);
  for (const ModeChain& chain : {RandomChain(random, 3, 1e-4), ModeChain::Uniform(2, 3e-5)}) {
    const double expected = BruteForce(history, chain);
    const ChainSteps steps = MakeChainSteps(history);
    EXPECT_NEAR(ExpectChain(steps, {chain.rate_matrix()}).log_likelihood, expected, 1e-11);
    EXPECT_NEAR(PredictiveLogLikelihood(history, 4, {chain}),
                expected - BruteForce(FirstVisits(history, 4), chain),
                1e-11);
  }
}

// Fisher's identity: d log p / d q_kl = G(k, l) - G(k, k).
TEST(ChainExpectationsTest, IntegralsAreTheGradient) {
  std::mt19937_64 random(TestSeed(4));
  const ChainHistory history = RandomHistory(random, 4, 12);
  const ChainSteps steps = MakeChainSteps(history);
  const ModeChain chain = RandomChain(random, 4, 2e-5);
  const Eigen::MatrixXd integral = ExpectChain(steps, {chain.rate_matrix()}).integrals.front();
  for (int from = 0; from < 4; ++from) {
    for (int to = 0; to < 4; ++to) {
      if (from == to) continue;
      const double step = 1e-4 * chain.rate_matrix()(from, to);
      const auto at = [&](double offset) {
        Eigen::MatrixXd rates = chain.rate_matrix();
        rates(from, to) += offset;
        rates(from, from) -= offset;
        return ExpectChain(steps, {rates}).log_likelihood;
      };
      const double expected = (at(step) - at(-step)) / (2.0 * step);
      EXPECT_NEAR(integral(from, to) - integral(from, from),
                  expected,
                  1e-5 * std::abs(expected) + 1e-4 / chain.leave_rate_per_s() * 1e-3)
          << from << " to " << to;
    }
  }
}

TEST(ChainExpectationsTest, TimeIsSpentSomewhere) {
  std::mt19937_64 random(TestSeed(5));
  const ChainHistory history = RandomHistory(random, 3, 40);
  double seconds = 0.0;
  for (std::size_t i = 1; i < history.visits.size(); ++i) {
    seconds += ToSeconds(history.visits[i].begin - history.visits[i - 1].end);
  }
  const ChainExpectations expected =
      ExpectChain(MakeChainSteps(history), {RandomChain(random, 3, 1e-4).rate_matrix()});
  EXPECT_NEAR(expected.integrals.front().trace() / seconds, 1.0, 1e-11);
}

TEST(ChainExpectationsTest, CuttingTheDayChangesNothingIfRatesStay) {
  std::mt19937_64 random(TestSeed(6));
  const ChainHistory history = RandomHistory(random, 3, 30);
  const ModeChain chain = RandomChain(random, 3, 1e-4);
  const ChainExpectations whole = ExpectChain(MakeChainSteps(history), {chain.rate_matrix()});
  const ChainExpectations cut =
      ExpectChain(MakeChainSteps(history, {kRhythmDay, 24}), std::vector(24, chain.rate_matrix()));
  EXPECT_NEAR(cut.log_likelihood, whole.log_likelihood, 1e-10);
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(3, 3);
  for (const Eigen::MatrixXd& integral : cut.integrals) sum += integral;
  const double scale = whole.integrals.front().maxCoeff();
  EXPECT_THAT(Eigen::MatrixXd(sum / scale),
              IsNearMatrix(Eigen::MatrixXd(whole.integrals.front() / scale), 1e-11));
}

// Steps at the end of each phase in place of gaps of several phases.
ChainSteps PhaseByPhase(const ChainSteps& steps) {
  ChainSteps single = steps;
  single.gap_of_step.clear();
  std::vector<Eigen::VectorXd> columns;
  const auto add = [&](const auto& self, int index, const Eigen::VectorXd& likelihoods) -> void {
    if (index >= 0) {
      const ChainSteps::Gap& gap = steps.gaps[static_cast<std::size_t>(index)];
      if (gap.composed()) {
        self(self, gap.first, Eigen::VectorXd::Ones(steps.states));
        return self(self, gap.second, likelihoods);
      }
    }
    single.gap_of_step.push_back(index);
    columns.push_back(likelihoods);
  };
  for (std::size_t t = 0; t < steps.gap_of_step.size(); ++t) {
    add(add, steps.gap_of_step[t], steps.likelihoods.col(static_cast<Eigen::Index>(t)));
  }
  single.likelihoods.resize(steps.states, static_cast<Eigen::Index>(columns.size()));
  for (std::size_t t = 0; t < columns.size(); ++t) {
    single.likelihoods.col(static_cast<Eigen::Index>(t)) = columns[t];
  }
  return single;
}

TEST(ChainExpectationsTest, GapsOfSeveralPhasesAreTheirPhasesOneByOne) {
  std::mt19937_64 random(TestSeed(8));
  ChainHistory history = RandomHistory(random, 3, 20);
  for (std::size_t i = 10; i < 20; ++i) {
    history.visits[i].begin += std::chrono::hours(24 * 40);
    history.visits[i].end += std::chrono::hours(24 * 40);
  }
  const ChainSteps steps = MakeChainSteps(history, {kRhythmWeek, 168});
  const ChainSteps single = PhaseByPhase(steps);
  EXPECT_LT(5 * steps.gap_of_step.size(), single.gap_of_step.size());
  std::vector<Eigen::MatrixXd> rates;
  for (int hour = 0; hour < 168; ++hour) {
    rates.push_back(RandomChain(random, 3, hour % 5 == 0 ? 2e-3 : 1e-5).rate_matrix());
  }
  const ChainExpectations expected = ExpectChain(single, rates);
  const ChainExpectations found = ExpectChain(steps, rates);
  EXPECT_NEAR(found.log_likelihood, expected.log_likelihood, 1e-10);
  for (std::size_t hour = 0; hour < rates.size(); ++hour) {
    EXPECT_THAT(Eigen::MatrixXd(found.integrals[hour] / 3600.0),
                IsNearMatrix(Eigen::MatrixXd(expected.integrals[hour] / 3600.0), 1e-9));
  }
}

// Jumps and times of paths drawn from the chain, counted.
TEST(ChainExpectationsTest, AgreesWithSimulatedPaths) {
  std::mt19937_64 random(TestSeed(7));
  const ModeChain chain = RandomChain(random, 3, 2e-4);
  const Stamp begin = StampFromSeconds(0.0);
  const Stamp end = begin + FromSeconds(3e7);
  const ChainPath path = SimulateChain(chain, 0, begin, end, random);
  std::vector<Stamp> stamps;
  for (Stamp stamp = begin; stamp < end; stamp += FromSeconds(2000.0)) stamps.push_back(stamp);
  const ChainHistory history = ObservePath(path, 3, stamps, 0.05, random);
  const Eigen::MatrixXd integral =
      ExpectChain(MakeChainSteps(history), {chain.rate_matrix()}).integrals.front();
  Eigen::MatrixXd jumps = Eigen::MatrixXd::Zero(3, 3);
  for (std::size_t i = 1; i < path.states.size(); ++i) {
    jumps(path.states[i - 1], path.states[i]) += 1.0;
  }
  for (int from = 0; from < 3; ++from) {
    for (int to = 0; to < 3; ++to) {
      if (from == to) continue;
      const double expected = chain.rate_matrix()(from, to) * integral(from, to);
      EXPECT_NEAR(expected, jumps(from, to), 4.0 * std::sqrt(jumps(from, to)));
    }
  }
}

}  // namespace
}  // namespace shiftmap::testing
