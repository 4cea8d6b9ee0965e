// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/rate_fit.h"

#include <gtest/gtest.h>

#include <Eigen/LU>

#include <cmath>
#include <random>
#include <vector>

#include "mapper/chain/chain_expectations.h"
#include "tests/support/random_map.h"
#include "tools/sim/simulate_chain.h"

namespace shiftmap::testing {
namespace {

std::vector<Stamp> Every(double seconds, int count) {
  std::vector<Stamp> stamps;
  for (int i = 0; i < count; ++i) stamps.push_back(StampFromSeconds(seconds * i));
  return stamps;
}

// Asymmetric rates, [1/s].
ModeChain ThreeStates() {
  Eigen::MatrixXd rates(3, 3);
  rates << -3e-5, 2e-5, 1e-5, 8e-5, -1e-4, 2e-5, 1e-5, 5e-6, -1.5e-5;
  return *ModeChain::FromRates(rates);
}

ChainHistory Simulate(const ModeChain& chain,
                      const std::vector<Stamp>& stamps,
                      double wrong,
                      std::mt19937_64& random) {
  const ChainPath path = SimulateChain(chain, 0, stamps.front(), stamps.back(), random);
  return ObservePath(path, chain.states(), stamps, wrong, random);
}

// Seen so often that nothing is hidden: the posterior is the Gamma distribution of counting.
TEST(RateFitTest, OfAPathThatIsSeenThroughoutCountsJumps) {
  std::mt19937_64 random(TestSeed(31));
  const std::vector<Stamp> stamps = Every(20.0, 40'000);
  const ChainPath path = SimulateChain(ThreeStates(), 0, stamps.front(), stamps.back(), random);
  const ChainSteps steps = MakeChainSteps(ObservePath(path, 3, stamps, 1e-12, random));
  Eigen::MatrixXd jumps = Eigen::MatrixXd::Zero(3, 3);
  Eigen::VectorXd seconds = Eigen::VectorXd::Zero(3);
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    seconds(path.At(stamps[i - 1])) += 20.0;
    if (path.At(stamps[i]) != path.At(stamps[i - 1])) {
      jumps(path.At(stamps[i - 1]), path.At(stamps[i])) += 1.0;
    }
  }
  const Gamma prior{0.5, 1e4};
  const RateFit general = FitRates(steps, ChainStructure::kGeneral, prior);
  EXPECT_TRUE(general.converged);
  double marginal = 0.0;
  for (int from = 0; from < 3; ++from) {
    for (int to = 0; to < 3; ++to) {
      if (from == to) continue;
      const Gamma posterior = general.PosteriorOfRate(from, to);
      EXPECT_NEAR(posterior.shape, 0.5 + jumps(from, to), 0.02 * (1.0 + jumps(from, to)));
      EXPECT_NEAR(posterior.exposure_s / (2e4 + seconds(from)), 1.0, 0.02);
      EXPECT_DOUBLE_EQ(posterior.mean(), general.chain.rate_matrix()(from, to));
    }
  }
  // log ∫ p(path | x) p(x) dx of Gamma priors in closed form, per parameter, against Laplace's.
  for (Eigen::Index i = 0; i < 6; ++i) {
    const Gamma posterior = general.Posterior(i);
    marginal += prior.shape * std::log(prior.exposure_s) - std::lgamma(prior.shape) +
                std::lgamma(posterior.shape) - posterior.shape * std::log(posterior.exposure_s);
    // What log_likelihood holds of x^jumps exp(-x time), at the rates found.
    const double count = posterior.shape - prior.shape;
    marginal -= count * general.log_rates(i) -
                (posterior.exposure_s - prior.exposure_s) * std::exp(general.log_rates(i));
  }
  EXPECT_NEAR(general.log_marginal, general.log_likelihood + marginal, 0.05);
}

TEST(RateFitTest, UniformRateIsTheLargestOfThePosterior) {
  std::mt19937_64 random(TestSeed(32));
  const ChainHistory history = Simulate(ModeChain::Uniform(2, 5e-5), Every(4e3, 150), 0.05, random);
  const ChainSteps steps = MakeChainSteps(history);
  const Gamma prior{0.5, 5e4};
  const RateFit fit = FitRates(steps, ChainStructure::kUniform, prior);
  const auto log_posterior = [&](double log_rate) {
    return ExpectChain(steps, {ModeChain::Uniform(2, std::exp(log_rate)).rate_matrix()})
               .log_likelihood +
           prior.LogDensityOfLog(log_rate);
  };
  // Brute force: the largest on a grid, and the integral over it.
  constexpr double kStep = 2e-3;
  double best = -1e300;
  double at = 0.0;
  for (double log_rate = -14.0; log_rate < -6.0; log_rate += kStep) {
    const double value = log_posterior(log_rate);
    if (value > best) {
      best = value;
      at = log_rate;
    }
  }
  double integral = 0.0;
  for (double log_rate = -14.0; log_rate < -6.0; log_rate += kStep) {
    integral += kStep * std::exp(log_posterior(log_rate) - best);
  }
  EXPECT_NEAR(fit.log_rates(0), at, kStep);
  EXPECT_NEAR(fit.log_marginal, best + std::log(integral), 0.02);
  EXPECT_TRUE(fit.chain.uniform());
}

TEST(RateFitTest, NoChangeOfTheGeneralRatesIsBetter) {
  std::mt19937_64 random(TestSeed(33));
  const ChainSteps steps = MakeChainSteps(Simulate(ThreeStates(), Every(9e3, 600), 0.02, random));
  const Gamma prior{0.5, 5e4};
  const RateFit fit = FitRates(steps, ChainStructure::kGeneral, prior);
  EXPECT_TRUE(fit.converged);
  const auto log_posterior = [&](const Eigen::MatrixXd& rates) {
    double sum = ExpectChain(steps, {rates}).log_likelihood;
    for (int from = 0; from < 3; ++from) {
      for (int to = 0; to < 3; ++to) {
        if (from != to) sum += prior.LogDensityOfLog(std::log(2.0 * rates(from, to)));
      }
    }
    return sum;
  };
  const double best = log_posterior(fit.chain.rate_matrix());
  for (int from = 0; from < 3; ++from) {
    for (int to = 0; to < 3; ++to) {
      if (from == to) continue;
      for (const double factor : {0.98, 1.02}) {
        Eigen::MatrixXd rates = fit.chain.rate_matrix();
        rates(from, from) -= (factor - 1.0) * rates(from, to);
        rates(from, to) *= factor;
        EXPECT_LT(log_posterior(rates), best) << from << " to " << to << " times " << factor;
      }
    }
  }
}

TEST(RateFitTest, WhereTheSearchBeginsDoesNotMatter) {
  std::mt19937_64 random(TestSeed(14));
  const ModeChain truth = ModeChain::Uniform(2, 1e-4);
  const ChainPath path =
      SimulateChain(truth, 1, StampFromSeconds(0.0), StampFromSeconds(1e6), random);
  std::vector<Stamp> stamps;
  for (double now = 0.0; now < 1e6; now += 3000.0) stamps.push_back(StampFromSeconds(now));
  const ChainSteps steps = MakeChainSteps(ObservePath(path, 3, stamps, 0.01, random));
  const Gamma prior{0.5, 0.5e5};
  for (const ChainStructure structure : {ChainStructure::kUniform, ChainStructure::kGeneral}) {
    const RateFit cold = FitRates(steps, structure, prior);
    const RateStart near{cold.log_rates.array() + 0.05, {}};
    const RateFit warm = FitRates(steps, structure, prior, near);
    EXPECT_LE(warm.iterations, cold.iterations);
    EXPECT_LT((warm.log_rates - cold.log_rates).cwiseAbs().maxCoeff(), 1e-4);
  }
}

// EM to its fixed point, and the Hessian by central differences of central differences.
struct SlowFit {
  Eigen::MatrixXd rates;
  double log_determinant = 0.0;  // Of the information, in log rates.
};

SlowFit FitSlowly(const ChainSteps& steps, ChainStructure structure, const Gamma& prior) {
  const int n = steps.states;
  const bool is_uniform = structure == ChainStructure::kUniform;
  Eigen::MatrixXd rates = ModeChain::Uniform(n - 1, prior.mean()).rate_matrix();
  double change = 1.0;
  for (int i = 0; i < 20'000 && change > 1e-9; ++i) {
    const Eigen::MatrixXd integral = ExpectChain(steps, {rates}).integrals.front();
    Eigen::MatrixXd jumps = rates.cwiseProduct(integral);
    jumps.diagonal().setZero();
    Eigen::MatrixXd next = Eigen::MatrixXd::Zero(n, n);
    for (int from = 0; from < n; ++from) {
      for (int to = 0; to < n; ++to) {
        if (from == to) continue;
        const double count = is_uniform ? jumps.sum() : jumps(from, to);
        const double time = is_uniform ? integral.trace() : integral(from, from) / (n - 1);
        next(from, to) = (prior.shape + count) / (prior.exposure_s + time) / (n - 1);
      }
    }
    next.diagonal() = -next.rowwise().sum();
    change = ((next - rates).array() / rates.array()).abs().maxCoeff();
    rates = next;
  }
  const Eigen::Index count = is_uniform ? 1 : n * (n - 1);
  const auto log_posterior = [&](const Eigen::VectorXd& moves) {
    Eigen::MatrixXd moved = rates;
    double sum = 0.0;
    Eigen::Index i = 0;
    for (int from = 0; from < n; ++from) {
      for (int to = 0; to < n; ++to) {
        if (from == to) continue;
        moved(from, to) *= std::exp(moves(is_uniform ? 0 : i++));
        if (!is_uniform) sum += prior.LogDensityOfLog(std::log((n - 1) * moved(from, to)));
      }
    }
    moved.diagonal().setZero();
    moved.diagonal() = -moved.rowwise().sum();
    if (is_uniform) sum += prior.LogDensityOfLog(std::log((n - 1) * moved(0, 1)));
    return sum + ExpectChain(steps, {moved}).log_likelihood;
  };
  Eigen::MatrixXd information(count, count);
  constexpr double kStep = 1e-2;
  for (Eigen::Index i = 0; i < count; ++i) {
    for (Eigen::Index j = 0; j < count; ++j) {
      double sum = 0.0;
      for (const double a : {-1.0, 1.0}) {
        for (const double b : {-1.0, 1.0}) {
          Eigen::VectorXd moves = Eigen::VectorXd::Zero(count);
          moves(i) += a * kStep;
          moves(j) += b * kStep;
          sum += a * b * log_posterior(moves);
        }
      }
      information(i, j) = -sum / (4.0 * kStep * kStep);
    }
  }
  return {rates, std::log(information.determinant())};
}

// Visits days apart that are wrong now and then, of chains that jump within hours or months.
TEST(RateFitTest, IsTheFixedPointOfExpectationMaximization) {
  std::mt19937_64 random(TestSeed(34));
  std::exponential_distribution<double> gap(1.0 / 30'000.0);
  for (const double speed : {0.03, 0.3, 3.0, 30.0}) {
    for (const int modes : {1, 2, 3}) {
      std::vector<Stamp> stamps;
      double now = 0.0;
      for (int i = 0; i < 80; ++i) stamps.push_back(StampFromSeconds(now += gap(random)));
      const ModeChain truth = ModeChain::Uniform(modes, speed * 1e-5);
      const ChainSteps steps =
          MakeChainSteps(Simulate(truth, stamps, 0.02, random), {}, modes == 3 ? 0.02 : 0.0);
      const Gamma prior{0.5, 5e4};
      for (const ChainStructure structure : {ChainStructure::kUniform, ChainStructure::kGeneral}) {
        const RateFit fit = FitRates(steps, structure, prior);
        const SlowFit slow = FitSlowly(steps, structure, prior);
        EXPECT_TRUE(fit.converged);
        for (int from = 0; from <= modes; ++from) {
          for (int to = 0; to <= modes; ++to) {
            if (from == to) continue;
            EXPECT_NEAR(fit.chain.rate_matrix()(from, to) / slow.rates(from, to), 1.0, 1e-4)
                << speed << ", " << modes << " modes, " << from << " to " << to;
          }
        }
        EXPECT_NEAR(-std::log(fit.covariance.determinant()), slow.log_determinant, 0.02);
        const Eigen::MatrixXd alone = MostProbableRates(steps, structure, prior);
        EXPECT_LT((alone.array() / slow.rates.array() - 1.0).abs().maxCoeff(), 1e-3);
      }
    }
  }
}

TEST(RateFitTest, WithoutEvidenceThePriorStays) {
  ChainHistory history{Signature("7"), 3, {}};
  for (const Stamp stamp : Every(1e4, 10)) {
    history.visits.push_back({stamp, stamp, Eigen::VectorXd::Zero(3)});
  }
  const Gamma prior{0.5, 5e4};
  for (const ChainStructure structure : {ChainStructure::kUniform, ChainStructure::kGeneral}) {
    const RateFit fit = FitRates(MakeChainSteps(history), structure, prior);
    EXPECT_NEAR(fit.chain.leave_rate_per_s(), 1e-5, 1e-9);
    EXPECT_NEAR(fit.Posterior(0).shape, 0.5, 1e-4);
    EXPECT_NEAR(fit.log_likelihood, 0.0, 1e-12);
    EXPECT_NEAR(fit.log_marginal, 0.0, 1e-4);
  }
}

}  // namespace
}  // namespace shiftmap::testing
