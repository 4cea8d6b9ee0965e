// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_chain.h"

#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/chain/chain_steps.h"
#include "mapper/parallel.h"

namespace shiftmap {
namespace {

RateInterval IntervalOf(double rate_per_s, const Gamma& posterior, double probability) {
  const double tail = 0.5 * (1.0 - probability);
  return {rate_per_s, posterior.Quantile(tail), posterior.Quantile(1.0 - tail)};
}

LearnedChain Describe(const ChainHistory& history, RateFit fit, double probability) {
  LearnedChain learned;
  learned.signature = history.signature;
  learned.visits = static_cast<std::int64_t>(history.visits.size());
  const int states = fit.chain.states();
  learned.low = Eigen::MatrixXd::Zero(states, states);
  learned.high = learned.low;
  for (int from = 0; from < states; ++from) {
    for (int to = 0; to < states; ++to) {
      if (from == to) continue;
      const RateInterval rate =
          IntervalOf(fit.chain.rate_matrix()(from, to), fit.PosteriorOfRate(from, to), probability);
      learned.low(from, to) = rate.low_per_s;
      learned.high(from, to) = rate.high_per_s;
    }
  }
  if (states > 1) {
    learned.leave =
        IntervalOf(fit.chain.leave_rate_per_s(), fit.PosteriorOfLeaveRate(), probability);
  }
  learned.fit = std::move(fit);
  return learned;
}

// The structure given, or the better of both.
struct Choice {
  RateFit fit;
  double general_gain = 0.0;

  // Where the searches ended, for one under almost the same prior.
  std::optional<RateStart> uniform;
  std::optional<RateStart> general;
};

// Chains of few states, whose rates cost nothing to fit.
constexpr int kFewStates = 4;

// The time of a general fit goes with about the fifth power of the states.
constexpr int kMaxGeneralStates = 10;

// Jumps that a fit takes the steps to have.
double ExpectedJumps(const ChainSteps& steps, const RateFit& uniform) {
  Duration time(0);
  for (const int gap : steps.gap_of_step) {
    if (gap >= 0) time += steps.gaps[static_cast<std::size_t>(gap)].length;
  }
  return uniform.chain.leave_rate_per_s() * ToSeconds(time);
}

// A rate for each pair of states is not to be told from fewer jumps than there are pairs.
bool MayTellPairs(const ChainSteps& steps, const RateFit& uniform) {
  if (steps.states <= kFewStates) return true;
  return steps.states <= kMaxGeneralStates &&
         ExpectedJumps(steps, uniform) >= steps.states * (steps.states - 1);
}

// The prior of each rate of a structure, with its part of what is stated of all.
Gamma WithStated(const Gamma& prior,
                 const StatedRate& stated,
                 ChainStructure structure,
                 int states) {
  const double rates = structure == ChainStructure::kUniform ? 1.0 : states * (states - 1.0);
  return {prior.shape + stated.jumps / rates, prior.exposure_s + stated.seconds / rates};
}

RateStart StartAt(const RateFit& fit) { return {fit.log_rates, fit.covariance}; }

Choice Fit(const ChainSteps& steps,
           const StatedRate& stated,
           const Gamma& shared,
           const ChainLearningOptions& options,
           const Choice& before) {
  Choice choice;
  if (steps.states < 2) return choice;
  const auto prior = [&](ChainStructure structure) {
    return WithStated(shared, stated, structure, steps.states);
  };
  if (options.structure) {
    const bool is_uniform = *options.structure == ChainStructure::kUniform;
    choice.fit = FitRates(steps,
                          *options.structure,
                          prior(*options.structure),
                          options.fit,
                          is_uniform ? before.uniform : before.general);
    (is_uniform ? choice.uniform : choice.general) = StartAt(choice.fit);
    return choice;
  }
  RateFit uniform = FitRates(steps,
                             ChainStructure::kUniform,
                             prior(ChainStructure::kUniform),
                             options.fit,
                             before.uniform);
  choice.uniform = StartAt(uniform);
  if (!MayTellPairs(steps, uniform)) {
    choice.fit = std::move(uniform);
    return choice;
  }
  RateFit general = FitRates(steps,
                             ChainStructure::kGeneral,
                             prior(ChainStructure::kGeneral),
                             options.fit,
                             before.general);
  choice.general = StartAt(general);
  choice.general_gain = general.log_marginal - uniform.log_marginal;
  choice.fit = choice.general_gain > 0.0 ? std::move(general) : std::move(uniform);
  return choice;
}

// So many groups tell the prior that they share; it is known no better than to a few percent.
constexpr std::size_t kPriorGroups = 200;

// Fits every `step`-th group.
void FitEvery(std::size_t step,
              const std::vector<ChainSteps>& steps,
              const std::vector<ChainHistory>& histories,
              const Gamma& prior,
              const ChainLearningOptions& options,
              std::vector<Choice>* choices) {
  const std::size_t count = (steps.size() + step - 1) / step;
  ForEachIndex(count, options.threads, [&](std::size_t i) {
    Choice& choice = (*choices)[i * step];
    choice = Fit(steps[i * step], histories[i * step].stated, prior, options, choice);
  });
}

// The prior that the groups' posteriors speak for.
Gamma SharedPrior(const std::vector<Choice>& choices, const ChainLearningOptions& options) {
  double weight = options.prior_groups;
  double mean = weight * options.prior.mean();
  double mean_log = weight * options.prior.MeanLog();
  for (const Choice& choice : choices) {
    const Eigen::Index count = choice.fit.log_rates.size();
    if (count == 0) continue;
    weight += 1.0;
    for (Eigen::Index i = 0; i < count; ++i) {
      const Gamma posterior = choice.fit.Posterior(i);
      mean += posterior.mean() / static_cast<double>(count);
      mean_log += posterior.MeanLog() / static_cast<double>(count);
    }
  }
  return GammaFromMeans(mean / weight, mean_log / weight);
}

}  // namespace

Status ChainLearningOptions::Validate() const {
  if (!(prior.shape > 0.0) || !std::isfinite(prior.shape)) {
    return InvalidArgument("chain learning: prior shape {}", prior.shape);
  }
  if (!(prior.exposure_s > 0.0) || !std::isfinite(prior.exposure_s)) {
    return InvalidArgument("chain learning: prior exposure {} s", prior.exposure_s);
  }
  if (!(prior_groups > 0.0))
    return InvalidArgument("chain learning: {} prior groups", prior_groups);
  if (!(interval > 0.0 && interval < 1.0)) {
    return InvalidArgument("chain learning: interval {}, expected within (0, 1)", interval);
  }
  if (fit.max_iterations < 1 || !(fit.tolerance > 0.0)) {
    return InvalidArgument(
        "chain learning: {} iterations, tolerance {}", fit.max_iterations, fit.tolerance);
  }
  if (!(gap_resolution >= 0.0)) {
    return InvalidArgument("chain learning: gap resolution {}", gap_resolution);
  }
  return OkStatus();
}

StatusOr<LearnedChains> LearnChains(const std::vector<ChainHistory>& histories,
                                    const ChainLearningOptions& options) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  std::vector<ChainSteps> steps;
  for (const ChainHistory& history : histories) {
    SHIFTMAP_RETURN_IF_ERROR(CheckHistory(history));
    steps.push_back(MakeChainSteps(history, {}, options.gap_resolution));
  }
  LearnedChains result;
  result.prior = options.prior;
  std::vector<Choice> choices(steps.size());
  constexpr int kMaxRounds = 20;
  constexpr double kSettled = 1e-2;
  const std::size_t step = options.share_prior ? steps.size() / kPriorGroups + 1 : 1;
  for (int round = 0;; ++round) {
    FitEvery(step, steps, histories, result.prior, options, &choices);
    if (!options.share_prior || round == kMaxRounds) break;
    const Gamma next = SharedPrior(choices, options);
    const double change = std::max(std::abs(std::log(next.shape / result.prior.shape)),
                                   std::abs(std::log(next.mean() / result.prior.mean())));
    if (change < kSettled) break;
    result.prior = next;
  }
  if (step > 1) FitEvery(1, steps, histories, result.prior, options, &choices);
  for (std::size_t i = 0; i < histories.size(); ++i) {
    LearnedChain learned = Describe(histories[i], std::move(choices[i].fit), options.interval);
    learned.general_gain = choices[i].general_gain;
    result.chains.push_back(std::move(learned));
  }
  return result;
}

StatusOr<LearnedChain> LearnChain(const ChainHistory& history,
                                  const ChainLearningOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(LearnedChains learned, LearnChains({history}, options));
  return std::move(learned.chains.front());
}

}  // namespace shiftmap
