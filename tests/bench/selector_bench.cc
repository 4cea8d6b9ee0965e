// SPDX-License-Identifier: Apache-2.0
//
// Time of a selection over the chain of IJRR 8.1: 30 and 250 observations of a landmark with three
// places, which moves every ten observations. The counter `optimal` is 1 if the sequence is as
// likely as the best.
#include <benchmark/benchmark.h>

#include <Eigen/Core>
#include <cmath>
#include <memory>
#include <random>
#include <vector>

#include "mapper/selection/selector.h"
#include "mapper/selection/viterbi.h"
#include "tools/experiment/incremental/observation_sequence.h"

namespace shiftmap {
namespace {

ModeSequenceProblem Sequence(int observations) {
  constexpr double kVariance = 0.2;
  const std::vector<Eigen::Vector2d> places = {{1.0, 1.0}, {2.2, 1.0}, {1.6, 2.04}};
  std::mt19937_64 random(1);
  std::normal_distribution<double> noise(0.0, std::sqrt(kVariance));
  std::vector<ObservationStep> steps;
  for (int t = 0; t < observations; ++t) {
    const Eigen::Vector2d& place = places[static_cast<std::size_t>(t / 10) % places.size()];
    const Eigen::Vector2d z = place + Eigen::Vector2d(noise(random), noise(random));
    Eigen::VectorXd log_density(3);
    for (Eigen::Index k = 0; k < 3; ++k) {
      log_density[k] = -0.5 * (z - places[static_cast<std::size_t>(k)]).squaredNorm() / kVariance;
    }
    steps.push_back({Eigen::Vector3d::Constant(0.6), log_density});
  }
  return MakeObservationSequence(Eigen::Vector3d::Constant(1.0 / 3.0), 1e-4, steps);
}

void Select(benchmark::State& state, const SelectorOptions& options) {
  const ModeSequenceProblem problem = Sequence(static_cast<int>(state.range(0)));
  const std::unique_ptr<Selector> selector = MakeSelector(options);
  std::vector<int> states;
  for (auto _ : state) {
    states = selector->Select(problem).states;
    benchmark::DoNotOptimize(states);
  }
  const double best = LogJoint(problem, MostLikelyModes(problem));
  state.counters["optimal"] = LogJoint(problem, states) > best - 1e-9 ? 1.0 : 0.0;
  state.SetItemsProcessed(state.iterations() * state.range(0));
}

void BM_Selector(benchmark::State& state, SelectorKind kind) {
  SelectorOptions options;
  options.kind = kind;
  Select(state, options);
}
BENCHMARK_CAPTURE(BM_Selector, viterbi, SelectorKind::kViterbi)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, mcts, SelectorKind::kMcts)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, em, SelectorKind::kEm)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, em_recursive, SelectorKind::kEmRecursive)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, nn, SelectorKind::kNearestNeighbor)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, maxmix, SelectorKind::kMaxMixture)->Arg(30)->Arg(250);
BENCHMARK_CAPTURE(BM_Selector, marginal, SelectorKind::kMarginal)->Arg(30)->Arg(250);

// The same number of iterations, shared by trees on threads of their own. Real time.
void BM_ParallelMcts(benchmark::State& state) {
  SelectorOptions options;
  options.kind = SelectorKind::kMcts;
  options.mcts.trees = static_cast<int>(state.range(1));
  Select(state, options);
}
BENCHMARK(BM_ParallelMcts)->Args({250, 1})->Args({250, 2})->UseRealTime();

}  // namespace
}  // namespace shiftmap
