// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/daily_rhythm.h"

#include <cmath>
#include <utility>

#include "mapper/chain/chain_expectations.h"
#include "mapper/chain/chain_steps.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr int kMaxIterations = 200;
constexpr double kTolerance = 1e-4;

// One step of EM for a phase.
Eigen::MatrixXd Maximize(const ModeChain& chain,
                         const Eigen::MatrixXd& integral,
                         const ModeChain& whole_day,
                         double weight) {
  const int n = chain.states();
  Eigen::MatrixXd rates = Eigen::MatrixXd::Zero(n, n);
  for (int from = 0; from < n; ++from) {
    for (int to = 0; to < n; ++to) {
      const double mean = whole_day.rate_matrix()(from, to);
      if (from == to || mean == 0.0) continue;
      const double jumps = chain.rate_matrix()(from, to) * integral(from, to);
      rates(from, to) = (weight + jumps) / (weight / mean + integral(from, from));
    }
  }
  rates.diagonal() = -rates.rowwise().sum();
  return rates;
}

// Largest relative change of a rate.
double Change(const Eigen::MatrixXd& before, const Eigen::MatrixXd& after) {
  double change = 0.0;
  for (Eigen::Index i = 0; i < before.size(); ++i) {
    if (before(i) != 0.0) change = std::max(change, std::abs(after(i) / before(i) - 1.0));
  }
  return change;
}

}  // namespace

std::vector<ModeChain> FitDailyRates(const ChainHistory& history,
                                     const ModeChain& whole_day,
                                     const DailyRhythmOptions& options) {
  const ChainSteps steps = MakeChainSteps(history, options.phases);
  std::vector<ModeChain> chains(static_cast<std::size_t>(options.phases), whole_day);
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const ChainExpectations expected = ExpectChain(steps, chains);
    double change = 0.0;
    for (std::size_t phase = 0; phase < chains.size(); ++phase) {
      const Eigen::MatrixXd rates =
          Maximize(chains[phase], expected.integrals[phase], whole_day, options.weight);
      change = std::max(change, Change(chains[phase].rate_matrix(), rates));
      StatusOr<ModeChain> chain = ModeChain::FromRates(rates);
      SHIFTMAP_CHECK(chain.ok(), "rates of a phase: {}", chain.status().ToString());
      chains[phase] = *std::move(chain);
    }
    if (change < kTolerance) break;
  }
  return chains;
}

StatusOr<DailyRhythm> LearnDailyRhythm(const ChainHistory& history,
                                       const ChainLearningOptions& learning,
                                       const DailyRhythmOptions& options) {
  if (options.phases < 2 || options.phases > 1440 || !(options.weight > 0.0) ||
      !(options.held_out > 0.0 && options.held_out < 1.0)) {
    return InvalidArgument("daily rhythm: {} phases, weight {}, held out {}",
                           options.phases,
                           options.weight,
                           options.held_out);
  }
  SHIFTMAP_RETURN_IF_ERROR(CheckHistory(history));
  const auto count = history.visits.size();
  const auto first =
      static_cast<std::size_t>(static_cast<double>(count) * (1.0 - options.held_out));
  if (first < 2 || count - first < 2) {
    return InvalidArgument("chain history of '{}': {} visits are too few for a rhythm",
                           history.signature.text(),
                           count);
  }
  const ChainHistory seen = FirstVisits(history, first);
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain plain, LearnChain(seen, learning));
  DailyRhythm result;
  result.held_out_gain =
      PredictiveLogLikelihood(history, first, FitDailyRates(seen, plain.chain(), options)) -
      PredictiveLogLikelihood(history, first, {plain.chain()});
  result.taken = result.held_out_gain > 0.0;
  SHIFTMAP_ASSIGN_OR_RETURN(const LearnedChain whole, LearnChain(history, learning));
  result.chains = {whole.chain()};
  if (result.taken) result.chains = FitDailyRates(history, whole.chain(), options);
  return result;
}

}  // namespace shiftmap
