// SPDX-License-Identifier: Apache-2.0
#include "mapper/selection/selector.h"

#include <cmath>
#include <functional>
#include <utility>

#include "mapper/selection/forward_backward.h"
#include "mapper/selection/per_step.h"
#include "mapper/selection/viterbi.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

Selection TakeLargest(Eigen::MatrixXd probabilities) {
  std::vector<int> states = LargestPerStep(probabilities);
  return {std::move(states), std::move(probabilities)};
}

// A selector that is a function.
class FunctionSelector final : public Selector {
 public:
  using Function = std::function<Selection(const ModeSequenceProblem&)>;

  explicit FunctionSelector(Function function) : function_(std::move(function)) {}
  Selection Select(const ModeSequenceProblem& problem) const override { return function_(problem); }

 private:
  Function function_;
};

FunctionSelector::Function SelectorFunction(const SelectorOptions& options) {
  using Problem = ModeSequenceProblem;
  switch (options.kind) {
    case SelectorKind::kViterbi:
      return [](const Problem& problem) { return Selection{MostLikelyModes(problem), {}}; };
    case SelectorKind::kMcts:
      return [mcts = options.mcts, seed = options.seed](const Problem& problem) {
        return Selection{MostVisitedModes(problem, mcts, seed), {}};
      };
    case SelectorKind::kEm:
      return [](const Problem& problem) { return TakeLargest(ExpectationPosteriors(problem)); };
    case SelectorKind::kEmRecursive:
      return [](const Problem& problem) { return TakeLargest(ForwardPosteriors(problem)); };
    case SelectorKind::kNearestNeighbor:
      return [seed = options.seed](const Problem& problem) {
        return Selection{NearestNeighborModes(problem, seed), {}};
      };
    case SelectorKind::kMaxMixture:
      return [](const Problem& problem) { return Selection{MaxMixtureModes(problem), {}}; };
    case SelectorKind::kNoHypotheses:
      return [](const Problem& problem) {
        CheckModeSequence(problem);
        const auto steps = static_cast<std::size_t>(problem.steps());
        return Selection{std::vector<int>(steps, problem.static_state), {}};
      };
    case SelectorKind::kMarginal:
      return [](const Problem& problem) { return TakeLargest(SmoothModes(problem).probabilities); };
  }
  SHIFTMAP_CHECK(false, "selector {}", static_cast<int>(options.kind));
}

}  // namespace

Status SelectorOptions::Validate() const {
  if (mcts.iterations < 1) {
    return InvalidArgument("mcts iterations: {}, expected 1 or more", mcts.iterations);
  }
  if (mcts.depth < 1) return InvalidArgument("mcts depth: {}, expected 1 or more", mcts.depth);
  if (!(mcts.exploration > 0.0 && std::isfinite(mcts.exploration))) {
    return InvalidArgument("mcts exploration: {}, expected > 0", mcts.exploration);
  }
  if (mcts.trees < 1) return InvalidArgument("mcts trees: {}, expected 1 or more", mcts.trees);
  return OkStatus();
}

std::unique_ptr<Selector> MakeSelector(const SelectorOptions& options) {
  return std::make_unique<FunctionSelector>(SelectorFunction(options));
}

std::vector<SelectorKind> AllSelectors() {
  return {SelectorKind::kViterbi,
          SelectorKind::kMcts,
          SelectorKind::kEm,
          SelectorKind::kEmRecursive,
          SelectorKind::kNearestNeighbor,
          SelectorKind::kMaxMixture,
          SelectorKind::kNoHypotheses,
          SelectorKind::kMarginal};
}

std::string SelectorName(SelectorKind kind) {
  switch (kind) {
    case SelectorKind::kViterbi:
      return "viterbi";
    case SelectorKind::kMcts:
      return "mcts";
    case SelectorKind::kEm:
      return "em";
    case SelectorKind::kEmRecursive:
      return "em-recursive";
    case SelectorKind::kNearestNeighbor:
      return "nn";
    case SelectorKind::kMaxMixture:
      return "maxmix";
    case SelectorKind::kNoHypotheses:
      return "nohyp";
    case SelectorKind::kMarginal:
      return "marginal";
  }
  SHIFTMAP_CHECK(false, "selector {}", static_cast<int>(kind));
}

StatusOr<SelectorKind> ParseSelector(const std::string& name) {
  for (const SelectorKind kind : AllSelectors()) {
    if (SelectorName(kind) == name) return kind;
  }
  return InvalidArgument(
      "selector '{}': expected viterbi, mcts, em, em-recursive, nn, maxmix, nohyp or marginal",
      name);
}

}  // namespace shiftmap
