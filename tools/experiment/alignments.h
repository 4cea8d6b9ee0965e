// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "tools/experiment/alignments_world.h"

namespace shiftmap {

enum class AlignmentMethod {
  kPosterior,      ///< Explain(), as the mapper decides.
  kMapper,         ///< The consensus where it needs no confirmation, else the posterior.
  kConsensus,      ///< AlignByConsensus().
  kConsistency,    ///< AlignByPairwiseConsistency().
  kNonConvexity,   ///< AlignByGraduatedNonConvexity().
  kConsensusSure,  ///< Where the mapper does not confirm it; so the next two.
  kConsistencySure,
  kNonConvexitySure,
};

inline constexpr std::size_t kAlignmentMethods = 8;

/// In tables, e.g. "pairwise consistency".
const char* ToString(AlignmentMethod method);

/// What was said of one pair.
struct AlignmentOutcome {
  AlignmentWorld world = AlignmentWorld::kPrior;
  int landmarks = 0;
  int stayed = 0;

  struct Answer {
    std::optional<bool> right;  ///< Nothing: it waits.
    double seconds = 0.0;       ///< Of the processor.
  };
  std::array<Answer, kAlignmentMethods> answers;

  // The rest is of the posterior. That fewer than two stayed is right where it is so.
  double probability = 0.0;  ///< Of the likeliest frame,
  bool is_right = false;     ///< which is right.
  double of_right = 0.0;     ///< Probability of all frames that are right.
};

AlignmentOutcome AlignPair(AlignmentWorld world, std::uint64_t seed);

/// Pairs of one world with the seeds `first_seed`, `first_seed` + 1, …
/// Determinism: independent of the number of threads, but for the seconds.
std::vector<AlignmentOutcome> AlignPairs(AlignmentWorld world,
                                         std::uint64_t first_seed,
                                         int pairs,
                                         int threads);

/// One method over pairs.
struct AlignmentTally {
  double pairs = 0.0;
  double decided = 0.0;
  double wrong = 0.0;     ///< Of the decided.
  double median_s = 0.0;  ///< Of the processor, per pair.
};

AlignmentTally TallyOf(AlignmentMethod method, const std::vector<AlignmentOutcome>& outcomes);

/// The posterior over pairs.
struct PosteriorTally {
  double log_score = 0.0;   ///< Mean log of the probability of what is right, 1e-6 at least. [nats]
  double waiting = 0.0;     ///< Pairs that wait,
  double among_kept = 0.0;  ///< of these, what is right has a probability of 0.01 or more.
};

PosteriorTally TallyPosterior(const std::vector<AlignmentOutcome>& outcomes);

/// Pairs whose likeliest frame has a probability within bounds.
struct CalibrationBin {
  double low = 0.0;  ///< Inclusive.
  double high = 0.0;
  double pairs = 0.0;
  double expected = 0.0;  ///< Sum of the probabilities.
  double right = 0.0;
};

std::vector<CalibrationBin> Calibrate(const std::vector<AlignmentOutcome>& outcomes);

}  // namespace shiftmap
