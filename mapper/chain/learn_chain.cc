// SPDX-License-Identifier: Apache-2.0
#include "mapper/chain/learn_chain.h"

#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "mapper/chain/chain_steps.h"
#include "mapper/parallel.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// The fits to a group's visits, of one structure or of both.
struct Fits {
  std::optional<RateFit> uniform;
  std::optional<RateFit> general;

  // Probability of the general structure.
  double GeneralShare() const {
    if (!uniform || !general) return general ? 1.0 : 0.0;
    const double share = 1.0 / (1.0 + std::exp(uniform->log_marginal - general->log_marginal));
    // Less does not change a rate, and a uniform chain has a closed form.
    constexpr double kLeastShare = 1e-3;
    return share < kLeastShare ? 0.0 : share;
  }

  const RateFit& Likelier() const { return GeneralShare() > 0.5 ? *general : *uniform; }
};

RateInterval IntervalOf(const Gamma& posterior, double probability) {
  const double tail = 0.5 * (1.0 - probability);
  return {posterior.mean(), posterior.Quantile(tail), posterior.Quantile(1.0 - tail)};
}

// A posterior of both structures together.
template <typename Posterior>
Gamma Mean(const Fits& fits, const Posterior& posterior) {
  const double share = fits.GeneralShare();
  if (share == 0.0) return posterior(*fits.uniform);
  if (share == 1.0) return posterior(*fits.general);
  return MixtureOf(posterior(*fits.uniform), posterior(*fits.general), share);
}

ModeChain MeanChain(const Fits& fits) {
  const double share = fits.GeneralShare();
  if (share == 0.0) return fits.uniform->chain;
  if (share == 1.0) return fits.general->chain;
  StatusOr<ModeChain> chain =
      ModeChain::FromRates((1.0 - share) * fits.uniform->chain.rate_matrix() +
                           share * fits.general->chain.rate_matrix());
  SHIFTMAP_CHECK(chain.ok(), "mean of two chains: {}", chain.status().ToString());
  return *std::move(chain);
}

LearnedChain Describe(const ChainHistory& history, const Fits& fits, double probability) {
  LearnedChain learned;
  learned.signature = history.signature;
  learned.visits = static_cast<std::int64_t>(history.visits.size());
  learned.general = fits.GeneralShare();
  if (!fits.uniform && !fits.general) {
    learned.low = learned.high = Eigen::MatrixXd::Zero(1, 1);
    return learned;
  }
  learned.fit = fits.Likelier();
  learned.chain = MeanChain(fits);
  const int states = learned.chain.states();
  learned.low = learned.high = Eigen::MatrixXd::Zero(states, states);
  for (int from = 0; from < states; ++from) {
    for (int to = 0; to < states; ++to) {
      if (from == to) continue;
      const RateInterval rate =
          IntervalOf(Mean(fits, [&](const RateFit& fit) { return fit.PosteriorOfRate(from, to); }),
                     probability);
      learned.low(from, to) = rate.low_per_s;
      learned.high(from, to) = rate.high_per_s;
    }
  }
  learned.leave = IntervalOf(
      Mean(fits, [](const RateFit& fit) { return fit.PosteriorOfLeaveRate(); }), probability);
  return learned;
}

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

std::optional<RateStart> StartAt(const std::optional<RateFit>& fit) {
  if (!fit) return std::nullopt;
  return RateStart{fit->log_rates, fit->covariance};
}

// @param before  Under almost the same prior; its searches' ends are the starts of these.
Fits Fit(const ChainSteps& steps,
         const StatedRate& stated,
         const Gamma& shared,
         const ChainLearningOptions& options,
         const Fits& before) {
  Fits fits;
  if (steps.states < 2) return fits;
  const auto fit = [&](ChainStructure structure, const std::optional<RateFit>& start) {
    return FitRates(
        steps, structure, WithStated(shared, stated, structure, steps.states), StartAt(start));
  };
  if (options.structure != ChainStructure::kGeneral) {
    fits.uniform = fit(ChainStructure::kUniform, before.uniform);
  }
  if (options.structure ? *options.structure == ChainStructure::kGeneral
                        : MayTellPairs(steps, *fits.uniform)) {
    fits.general = fit(ChainStructure::kGeneral, before.general);
  }
  return fits;
}

// So many groups tell the prior that they share; it is known no better than to a few percent.
constexpr std::size_t kPriorGroups = 200;

// Fits every `step`-th group.
void FitEvery(std::size_t step,
              const std::vector<ChainSteps>& steps,
              const std::vector<ChainHistory>& histories,
              const Gamma& prior,
              const ChainLearningOptions& options,
              std::vector<Fits>* fits) {
  const std::size_t count = (steps.size() + step - 1) / step;
  ForEachIndex(count, options.threads, [&](std::size_t i) {
    Fits& group = (*fits)[i * step];
    group = Fit(steps[i * step], histories[i * step].stated, prior, options, group);
  });
}

// The means over a fit's parameters of E x and E log x.
struct ParameterMeans {
  double mean = 0.0;
  double log = 0.0;
};

ParameterMeans MeansOf(const std::optional<RateFit>& fit) {
  ParameterMeans means;
  if (!fit) return means;
  const Eigen::Index count = fit->log_rates.size();
  for (Eigen::Index i = 0; i < count; ++i) {
    const Gamma posterior = fit->Posterior(i);
    means.mean += posterior.mean() / static_cast<double>(count);
    means.log += posterior.MeanLog() / static_cast<double>(count);
  }
  return means;
}

// The prior that the groups' posteriors speak for.
Gamma SharedPrior(const std::vector<Fits>& fits, const ChainLearningOptions& options) {
  double weight = options.prior_groups;
  double mean = weight * options.prior.mean();
  double mean_log = weight * options.prior.MeanLog();
  for (const Fits& group : fits) {
    if (!group.uniform && !group.general) continue;
    weight += 1.0;
    const double share = group.GeneralShare();
    const ParameterMeans uniform = MeansOf(group.uniform);
    const ParameterMeans general = MeansOf(group.general);
    mean += (1.0 - share) * uniform.mean + share * general.mean;
    mean_log += (1.0 - share) * uniform.log + share * general.log;
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
  std::vector<Fits> fits(steps.size());
  constexpr int kMaxRounds = 20;
  constexpr double kSettled = 1e-2;
  const std::size_t step = options.share_prior ? steps.size() / kPriorGroups + 1 : 1;
  for (int round = 0;; ++round) {
    FitEvery(step, steps, histories, result.prior, options, &fits);
    if (!options.share_prior || round == kMaxRounds) break;
    const Gamma next = SharedPrior(fits, options);
    const double change = std::max(std::abs(std::log(next.shape / result.prior.shape)),
                                   std::abs(std::log(next.mean() / result.prior.mean())));
    if (change < kSettled) break;
    result.prior = next;
  }
  if (step > 1) FitEvery(1, steps, histories, result.prior, options, &fits);
  for (std::size_t i = 0; i < histories.size(); ++i) {
    result.chains.push_back(Describe(histories[i], fits[i], options.interval));
  }
  return result;
}

StatusOr<LearnedChain> LearnChain(const ChainHistory& history,
                                  const ChainLearningOptions& options) {
  SHIFTMAP_ASSIGN_OR_RETURN(LearnedChains learned, LearnChains({history}, options));
  return std::move(learned.chains.front());
}

}  // namespace shiftmap
