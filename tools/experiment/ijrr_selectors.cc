// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/ijrr_selectors.h"

#include <cmath>
#include <memory>
#include <random>
#include <utility>

#include "mapper/parallel.h"
#include "mapper/selection/viterbi.h"
#include "mapstore/geometry/covariance.h"
#include "tools/experiment/ijrr_slam.h"
#include "tools/experiment/incremental/observation_sequence.h"
#include "tools/experiment/processor_time.h"
#include "tools/experiment/sample_mean.h"

namespace shiftmap {
namespace {

// What one realization gives for one selector.
struct Sample {
  double wrong_ratio = 0.0;
  double joint_deficit = 0.0;
  double select_us = 0.0;
  double slam_squared_error_m2 = 0.0;
  double slam_wrong_ratio = 0.0;
  double slam_alternations = 0.0;
};

// Log joints of equally likely sequences differ by rounding.
constexpr double kSameLogJoint = 1e-9;

enum class Stream : std::uint64_t { kSelection, kSlam };

// The same draws for every selector, and for every noise up to their scale.
std::mt19937_64 RandomOf(const IjrrSelectorsOptions& options, int run, Stream stream) {
  std::seed_seq sequence{
      options.seed, static_cast<std::uint64_t>(run), static_cast<std::uint64_t>(stream)};
  return std::mt19937_64(sequence);
}

double WrongRatio(const std::vector<int>& states, const std::vector<int>& truth) {
  int wrong = 0;
  for (std::size_t t = 0; t < truth.size(); ++t) wrong += states[t] != truth[t] ? 1 : 0;
  return wrong / static_cast<double>(truth.size());
}

// One realization with every selector.
std::vector<Sample> RunOnce(const IjrrSelectorsOptions& options,
                            double noise_m2,
                            const std::vector<NamedSelector>& selectors,
                            int run) {
  const IjrrRealization realization = SimulateIjrr(options, noise_m2, run);
  const ModeSequenceProblem sequence = MakeIjrrSequence(options, noise_m2, realization);
  const double best = LogJoint(sequence, MostLikelyModes(sequence));
  std::mt19937_64 random = RandomOf(options, run, Stream::kSlam);
  const IjrrSlamProblem slam = SimulateIjrrSlam(options, noise_m2, random);
  std::vector<Sample> samples;
  for (const NamedSelector& item : selectors) {
    SelectorOptions selector_options = item.options;
    selector_options.seed += static_cast<std::uint64_t>(run);
    const std::unique_ptr<Selector> selector = MakeSelector(selector_options);
    Sample sample;
    const double begin_s = ThreadProcessorSeconds();
    const std::vector<int> states = selector->Select(sequence).states;
    sample.select_us = 1e6 * (ThreadProcessorSeconds() - begin_s);
    sample.wrong_ratio = WrongRatio(states, realization.truth);
    sample.joint_deficit = best - LogJoint(sequence, states);
    const IjrrSlamResult result = SolveIjrrSlam(options, selector_options, slam);
    sample.slam_squared_error_m2 = result.squared_error_m2;
    sample.slam_wrong_ratio = WrongRatio(result.states, slam.truth);
    sample.slam_alternations = result.alternations;
    samples.push_back(sample);
  }
  return samples;
}

// @param samples  By run, then selector.
IjrrSelectorsRow Summarize(double noise_m2,
                           const std::string& selector,
                           std::size_t index,
                           const std::vector<std::vector<Sample>>& samples) {
  const auto mean = [&](const auto& value) {
    std::vector<double> values;
    for (const std::vector<Sample>& run : samples) values.push_back(value(run[index]));
    return MeanOf(values);
  };
  IjrrSelectorsRow row;
  row.noise_m2 = noise_m2;
  row.selector = selector;
  const SampleMean wrong = mean([](const Sample& s) { return s.wrong_ratio; });
  row.wrong_ratio = wrong.mean;
  row.wrong_ratio_se = wrong.standard_error;
  row.optimal_ratio =
      mean([](const Sample& s) { return s.joint_deficit < kSameLogJoint ? 1. : 0.; }).mean;
  row.joint_deficit = mean([](const Sample& s) { return s.joint_deficit; }).mean;
  row.select_us = mean([](const Sample& s) { return s.select_us; }).mean;
  row.slam_rmse_m = std::sqrt(mean([](const Sample& s) { return s.slam_squared_error_m2; }).mean);
  const SampleMean slam_wrong = mean([](const Sample& s) { return s.slam_wrong_ratio; });
  row.slam_wrong_ratio = slam_wrong.mean;
  row.slam_wrong_ratio_se = slam_wrong.standard_error;
  row.slam_alternations = mean([](const Sample& s) { return s.slam_alternations; }).mean;
  return row;
}

}  // namespace

Status IjrrSelectorsOptions::Validate() const {
  if (runs < 1) return InvalidArgument("runs: {}, expected 1 or more", runs);
  if (threads < 1) return InvalidArgument("threads: {}, expected 1 or more", threads);
  if (noises_m2.empty()) return InvalidArgument("noises_m2: empty");
  for (const double noise : noises_m2) {
    if (!(noise > 0.0 && std::isfinite(noise))) {
      return InvalidArgument("noises_m2: {}, expected > 0", noise);
    }
  }
  if (places.size() < 2) return InvalidArgument("places: {}, expected 2 or more", places.size());
  if (observations_per_place < 1) {
    return InvalidArgument("observations_per_place: {}, expected 1 or more",
                           observations_per_place);
  }
  if (!(change_probability > 0.0 && change_probability < 1.0)) {
    return InvalidArgument("change_probability: {}, expected in (0, 1)", change_probability);
  }
  if (!(detection_probability > 0.0 && detection_probability < 1.0)) {
    return InvalidArgument("detection_probability: {}, expected in (0, 1)", detection_probability);
  }
  if (!(prior_sd_m > 0.0) || !(process_sd.array() > 0.0).all() || max_alternations < 1) {
    return InvalidArgument("prior_sd_m, process_sd and max_alternations: expected > 0");
  }
  return SelectorOptions{.mcts = mcts}.Validate();
}

std::vector<NamedSelector> IjrrSelectors(const IjrrSelectorsOptions& options) {
  std::vector<NamedSelector> selectors;
  for (const SelectorKind kind : AllSelectors()) {
    SelectorOptions selector{kind, options.mcts, options.seed};
    selector.mcts.roll_out = RollOutPolicy::kModel;
    selectors.push_back({SelectorName(kind), selector});
    if (kind != SelectorKind::kMcts) continue;
    selector.mcts.roll_out = RollOutPolicy::kUniform;
    selectors.push_back({"mcts-uniform", selector});
  }
  return selectors;
}

IjrrRealization SimulateIjrr(const IjrrSelectorsOptions& options, double noise_m2, int run) {
  std::mt19937_64 random = RandomOf(options, run, Stream::kSelection);
  std::normal_distribution<double> normal;
  IjrrRealization realization;
  for (std::size_t k = 0; k < options.places.size(); ++k) {
    for (int i = 0; i < options.observations_per_place; ++i) {
      const double x = normal(random);
      const double y = normal(random);
      realization.truth.push_back(static_cast<int>(k));
      realization.observations.push_back(options.places[k] +
                                         std::sqrt(noise_m2) * Eigen::Vector2d(x, y));
    }
  }
  return realization;
}

ModeSequenceProblem MakeIjrrSequence(const IjrrSelectorsOptions& options,
                                     double noise_m2,
                                     const IjrrRealization& realization) {
  const auto modes = std::ssize(options.places);
  Eigen::VectorXd initial = Eigen::VectorXd::Constant(modes, 1.0 / static_cast<double>(modes));
  if (options.known_start) initial = Eigen::VectorXd::Unit(modes, 0);
  const Eigen::VectorXd detection = Eigen::VectorXd::Constant(modes, options.detection_probability);
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * noise_m2;
  std::vector<ObservationStep> steps;
  for (const Eigen::Vector2d& z : realization.observations) {
    Eigen::VectorXd log_density(modes);
    for (std::size_t k = 0; k < options.places.size(); ++k) {
      log_density[static_cast<Eigen::Index>(k)] = LogGaussian(z - options.places[k], cov);
    }
    steps.push_back({detection, std::move(log_density)});
  }
  return MakeObservationSequence(initial, options.change_probability, steps);
}

StatusOr<std::vector<IjrrSelectorsRow>> RunIjrrSelectors(
    const IjrrSelectorsOptions& options, const std::function<void(double done)>& progress) {
  SHIFTMAP_RETURN_IF_ERROR(options.Validate());
  const std::vector<NamedSelector> selectors = IjrrSelectors(options);
  std::vector<IjrrSelectorsRow> rows;
  for (std::size_t n = 0; n < options.noises_m2.size(); ++n) {
    const double noise = options.noises_m2[n];
    std::vector<std::vector<Sample>> samples(static_cast<std::size_t>(options.runs));
    ForEachIndex(samples.size(), options.threads, [&](std::size_t run) {
      samples[run] = RunOnce(options, noise, selectors, static_cast<int>(run));
    });
    for (std::size_t i = 0; i < selectors.size(); ++i) {
      rows.push_back(Summarize(noise, selectors[i].name, i, samples));
    }
    if (progress) {
      progress(static_cast<double>(n + 1) / static_cast<double>(options.noises_m2.size()));
    }
  }
  return rows;
}

}  // namespace shiftmap
