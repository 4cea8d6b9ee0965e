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

// One tree that decides one step.
class StepSearch {
 public:
  // @param before  State at the step before; any for the first.
  StepSearch(const ModeSequenceProblem& problem,
             const MctsOptions& options,
             int step,
             int before,
             std::uint64_t seed)
      : problem_(problem),
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
      WeighStates(step, state);
      int to = kDeadEndState;
      if (in_tree) {
        const int node = path_.back();
        const std::vector<int> untried = UntriedStates(node);
        in_tree = untried.empty();
        if (!untried.empty()) {
          to = untried[random_() % untried.size()];
          path_.push_back(tree_.Expand(node, to));
        } else if (AnyPossible()) {
          to = tree_.BestChild(node, options_.exploration, range);
          path_.push_back(tree_.Child(node, to));
        }
      } else if (AnyPossible()) {
        to = RollOut();
      }
      if (to == kDeadEndState) {
        value = kDeadEnd;
        break;
      }
      value += log_factors_[static_cast<std::size_t>(to)];
      state = to;
      ++step;
    }
    for (const int node : path_) tree_.Record(node, value);
  }

  // log ψ of going to each state.
  void WeighStates(int step, int from) {
    log_factors_.resize(static_cast<std::size_t>(problem_.states()));
    for (int to = 0; to < problem_.states(); ++to) {
      log_factors_[static_cast<std::size_t>(to)] = problem_.LogFactor(step, from, to);
    }
  }

  bool IsPossible(int state) const {
    return log_factors_[static_cast<std::size_t>(state)] > kLogZero;
  }
  bool AnyPossible() const {
    return *std::max_element(log_factors_.begin(), log_factors_.end()) > kLogZero;
  }

  std::vector<int> UntriedStates(int node) const {
    std::vector<int> states = tree_.UnvisitedChildren(node);
    std::erase_if(states, [&](int state) { return !IsPossible(state); });
    return states;
  }

  // Draws a possible state.
  int RollOut() {
    const bool uniform = options_.roll_out == RollOutPolicy::kUniform;
    const double largest = *std::max_element(log_factors_.begin(), log_factors_.end());
    weights_.clear();
    double sum = 0.0;
    for (const double log_factor : log_factors_) {
      const bool possible = log_factor > kLogZero;
      weights_.push_back(uniform ? (possible ? 1.0 : 0.0) : std::exp(log_factor - largest));
      sum += weights_.back();
    }
    double left = Uniform(random_) * sum;
    int drawn = kDeadEndState;
    for (int state = 0; state < problem_.states(); ++state) {
      if (!IsPossible(state)) continue;
      drawn = state;
      left -= weights_[static_cast<std::size_t>(state)];
      if (left < 0.0) break;
    }
    return drawn;
  }

  static constexpr int kDeadEndState = -1;

  const ModeSequenceProblem& problem_;
  const MctsOptions& options_;
  int first_;
  int end_;
  int before_;
  std::mt19937_64 random_;
  SearchTree tree_;
  std::vector<int> path_;
  std::vector<double> log_factors_;
  std::vector<double> weights_;
};

// Visit counts of the states of a step, added over all trees.
std::vector<int> SearchStep(const ModeSequenceProblem& problem,
                            const MctsOptions& options,
                            int step,
                            int before,
                            std::mt19937_64& seeds) {
  std::vector<std::future<std::vector<int>>> others;
  const auto search = [&](int tree, std::uint64_t seed) {
    const int share = options.iterations / options.trees;
    const int rest = options.iterations % options.trees;
    return StepSearch(problem, options, step, before, seed).Run(share + (tree < rest ? 1 : 0));
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
  std::mt19937_64 seeds(seed);
  std::vector<int> states;
  int before = 0;
  for (int step = 0; step < problem.steps(); ++step) {
    const std::vector<int> visits = SearchStep(problem, options, step, before, seeds);
    before = static_cast<int>(std::max_element(visits.begin(), visits.end()) - visits.begin());
    states.push_back(before);
  }
  return states;
}

}  // namespace shiftmap
