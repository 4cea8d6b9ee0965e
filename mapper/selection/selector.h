// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "mapper/selection/mcts.h"
#include "mapper/selection/mode_sequence.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The component selectors of IJRR 5 and 8, and the exact ones.
enum class SelectorKind {
  kViterbi,          ///< `viterbi`: the optimum of IJRR (19), MostLikelyModes().
  kMcts,             ///< `mcts`: a search for it, IJRR (24)-(26), MostVisitedModes().
  kEm,               ///< `em`: IJRR (23) as printed, ExpectationPosteriors().
  kEmRecursive,      ///< `em-recursive`: IJRR (23) read recursively, ForwardPosteriors().
  kNearestNeighbor,  ///< `nn`: IJRR (22), NearestNeighborModes().
  kMaxMixture,       ///< `maxmix`: IJRR (14), MaxMixtureModes(), at every linearization.
  kNoHypotheses,     ///< `nohyp`: one position per landmark, the problem's static state.
  kMarginal,         ///< `marginal`: largest posterior given all observations, SmoothModes().
};

struct SelectorOptions {
  SelectorKind kind = SelectorKind::kViterbi;
  MctsOptions mcts;
  std::uint64_t seed = 1;  ///< Of mcts, and of equal choices of nn.

  /// Errors: kInvalidArgument naming the first member out of range.
  Status Validate() const;
};

struct Selection {
  std::vector<int> states;  ///< δ_1:T.

  /// T x n, what the selector itself takes for Pr(δ_t = k): em and em-recursive (23), marginal the
  /// posterior given all observations. Nothing for selectors that know no probabilities.
  std::optional<Eigen::MatrixXd> probabilities;
};

/// Chooses the mode sequence of one group. Threads: const-safe. Determinism: the same problem and
/// seed give the same states.
class Selector {
 public:
  virtual ~Selector() = default;
  virtual Selection Select(const ModeSequenceProblem& problem) const = 0;
};

/// Precondition: valid options.
std::unique_ptr<Selector> MakeSelector(const SelectorOptions& options);

/// All kinds, in the order of the enumeration.
std::vector<SelectorKind> AllSelectors();

/// The name in options and files, e.g. "viterbi".
std::string SelectorName(SelectorKind kind);

/// Errors: kInvalidArgument for a name that no selector has.
StatusOr<SelectorKind> ParseSelector(const std::string& name);

}  // namespace shiftmap
