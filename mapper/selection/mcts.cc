// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/mcts.h"

#include <algorithm>
#include <cmath>
#include <future>
#include <random>

#include "localizer/hypothesis/log_math.h"
#include "mapper/selection/search_tree.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

// What is recorded for a sequence that cannot go on. Impossible steps are not tried otherwise: one
// of them would leave no resolution to the normalized values of the others.
constexpr double kDeadEnd = -1e12;

// In [0, 1); the same on every platform.
double Uniform(std::mt19937_64& random) { return static_cast<double>(random() >> 11) * 0x1p-53; }

// log ψ of every transition at every step, and what a roll-out draws by: computed once, used by
// every sequence of every tree.
class FactorTable {
 public:
  FactorTable(const ModeSequenceProblem& problem, RollOutPolicy policy) : n_(problem.states()) {
    for (int step = 0; step < problem.steps(); ++step) {
      for (int from = 0; from < n_; ++from) AddRow(problem, policy, step, from);
    }
  }

  // log ψ of going to each state.
  const double* LogFactors(int step, int from) const {
    return log_factors_.data() + At(step, from);
  }

  bool AnyPossible(int step, int from) const { return sums_[At(step, from) / n()] > 0.0; }

  // A possible state, if there is one, for a draw in [0, 1).
  int Draw(int step, int from, double draw) const {
    const double* weights = weights_.data() + At(step, from);
    double left = draw * sums_[At(step, from) / n()];
    int drawn = 0;
    for (int state = 0; state < n_; ++state) {
      if (weights[state] == 0.0) continue;
      drawn = state;
      left -= weights[state];
      if (left < 0.0) break;
    }
    return drawn;
  }

 private:
  void AddRow(const ModeSequenceProblem& problem, RollOutPolicy policy, int step, int from) {
    const std::size_t begin = log_factors_.size();
    for (int to = 0; to < n_; ++to) log_factors_.push_back(problem.LogFactor(step, from, to));
    const double largest = *std::max_element(
        log_factors_.begin() + static_cast<std::ptrdiff_t>(begin), log_factors_.end());
    double sum = 0.0;
    for (std::size_t i = begin; i < log_factors_.size(); ++i) {
      const bool possible = log_factors_[i] > kLogZero;
      const bool uniform = policy == RollOutPolicy::kUniform;
      weights_.push_back(!possible ? 0.0 : (uniform ? 1.0 : std::exp(log_factors_[i] - largest)));
      sum += weights_.back();
    }
    sums_.push_back(sum);
  }

  std::size_t n() const { return static_cast<std::size_t>(n_); }
  std::size_t At(int step, int from) const {
    return (static_cast<std::size_t>(step) * n() + static_cast<std::size_t>(from)) * n();
  }

  int n_;
  std::vector<double> log_factors_;  // By step, state before, state.
  std::vector<double> weights_;      // The same.
  std::vector<double> sums_;         // Of the weights, by step and state before.
};

// One tree that decides one step.
class StepSearch {
 public:
  // @param before  State at the step before; any for the first.
  StepSearch(const ModeSequenceProblem& problem,
             const FactorTable& factors,
             const MctsOptions& options,
             int step,
             int before,
             std::uint64_t seed)
      : problem_(problem),
        factors_(factors),
        options_(options),
        first_(step),
        end_(std::min(problem.steps(), step + options.depth)),
        before_(before),
        random_(seed),
        tree_(problem.states()) {}

  // Returns how often each state of the step was visited.
  std::vector<int> Run(int iterations) {
    for (int i = 0; i < iterations; ++i) Iterate();
    std::vector<int> visits(static_cast<std::size_t>(problem_.states()), 0);
    for (int state = 0; state < problem_.states(); ++state) {
      const int child = tree_.Child(SearchTree::kRoot, state);
      if (child != SearchTree::kNoNode)
        visits[static_cast<std::size_t>(state)] = tree_.Visits(child);
    }
    return visits;
  }

 private:
  void Iterate() {
    // The tree does not change while a node is selected.
    const ValueRange range = tree_.Range();
    path_.assign(1, SearchTree::kRoot);
    int step = first_;
    int state = before_;
    double value = 0.0;
    bool in_tree = true;
    while (step < end_) {
      const double* log_factors = factors_.LogFactors(step, state);
      const bool any_possible = factors_.AnyPossible(step, state);
      int to = kDeadEndState;
      if (in_tree) {
        const int node = path_.back();
        const std::vector<int> untried = UntriedStates(node, log_factors);
        in_tree = untried.empty();
        if (!untried.empty()) {
          to = untried[random_() % untried.size()];
          path_.push_back(tree_.Expand(node, to));
        } else if (any_possible) {
          to = tree_.BestChild(node, options_.exploration, range);
          path_.push_back(tree_.Child(node, to));
        }
      } else if (any_possible) {
        to = factors_.Draw(step, state, Uniform(random_));
      }
      if (to == kDeadEndState) {
        value = kDeadEnd;
        break;
      }
      value += log_factors[to];
      state = to;
      ++step;
    }
    for (const int node : path_) tree_.Record(node, value);
  }

  std::vector<int> UntriedStates(int node, const double* log_factors) const {
    std::vector<int> states = tree_.UnvisitedChildren(node);
    std::erase_if(states, [&](int state) { return log_factors[state] <= kLogZero; });
    return states;
  }

  static constexpr int kDeadEndState = -1;

  const ModeSequenceProblem& problem_;
  const FactorTable& factors_;
  const MctsOptions& options_;
  int first_;
  int end_;
  int before_;
  std::mt19937_64 random_;
  SearchTree tree_;
  std::vector<int> path_;
};

// Visit counts of the states of a step, added over all trees.
std::vector<int> SearchStep(const ModeSequenceProblem& problem,
                            const FactorTable& factors,
                            const MctsOptions& options,
                            int step,
                            int before,
                            std::mt19937_64& seeds) {
  std::vector<std::future<std::vector<int>>> others;
  const auto search = [&](int tree, std::uint64_t seed) {
    const int share = options.iterations / options.trees;
    const int rest = options.iterations % options.trees;
    return StepSearch(problem, factors, options, step, before, seed)
        .Run(share + (tree < rest ? 1 : 0));
  };
  const std::uint64_t first_seed = seeds();
  for (int tree = 1; tree < options.trees; ++tree) {
    others.push_back(std::async(std::launch::async, search, tree, seeds()));
  }
  std::vector<int> visits = search(0, first_seed);
  for (std::future<std::vector<int>>& other : others) {
    const std::vector<int> more = other.get();
    for (std::size_t state = 0; state < visits.size(); ++state) visits[state] += more[state];
  }
  return visits;
}

}  // namespace

std::vector<int> MostVisitedModes(const ModeSequenceProblem& problem,
                                  const MctsOptions& options,
                                  std::uint64_t seed) {
  CheckModeSequence(problem);
  SHIFTMAP_CHECK(options.iterations > 0 && options.depth > 0 && options.trees > 0,
                 "{} iterations, depth {}, {} trees",
                 options.iterations,
                 options.depth,
                 options.trees);
  const FactorTable factors(problem, options.roll_out);
  std::mt19937_64 seeds(seed);
  std::vector<int> states;
  int before = 0;
  for (int step = 0; step < problem.steps(); ++step) {
    const std::vector<int> visits = SearchStep(problem, factors, options, step, before, seeds);
    before = static_cast<int>(std::max_element(visits.begin(), visits.end()) - visits.begin());
    states.push_back(before);
  }
  return states;
}

}  // namespace shiftmap
