// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/alignments.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "mapper/alignment/explain_alignment.h"
#include "mapper/mapper_options.h"
#include "mapper/parallel.h"
#include "mapper/registration/confirm_alignment.h"
#include "mapstore/core/median.h"
#include "proto/core/check.h"
#include "tools/experiment/alignments_comparators.h"
#include "tools/experiment/processor_time.h"

namespace shiftmap {
namespace {

using Answer = AlignmentOutcome::Answer;

std::size_t At(AlignmentMethod method) { return static_cast<std::size_t>(method); }

// The reference with one place of each landmark, the last one: what methods without modes know.
JointPoints LastPlaces(const AlignmentPair& pair) {
  const std::size_t landmarks = pair.other.points.size();
  const auto rows = static_cast<Eigen::Index>(2 * landmarks);
  JointPoints last = {pair.reference.points, pair.reference.covariance.topLeftCorner(rows, rows)};
  last.points.resize(landmarks);
  return last;
}

// Scores the methods on one pair.
class PairScore {
 public:
  PairScore(AlignmentWorld world, std::uint64_t seed) : pair_(DrawAlignmentPair(world, seed)) {
    run_map_.points = pair_.other.points;
    outcome_.world = world;
    outcome_.landmarks = static_cast<int>(pair_.other.points.size());
    outcome_.stayed = pair_.stayed;
  }

  AlignmentOutcome Score() {
    ScorePosterior();
    const JointPoints last = LastPlaces(pair_);
    const std::optional<Alignment> consensus =
        Compare(AlignmentMethod::kConsensus, AlignmentMethod::kConsensusSure, [&] {
          return AlignByConsensus(
              pair_.reference.points, pair_.other.points, pair_.area_m2, options_.alignment);
        });
    Compare(AlignmentMethod::kConsistency, AlignmentMethod::kConsistencySure, [&] {
      return AlignByPairwiseConsistency(last, pair_.other, pair_.sd_scale);
    });
    Compare(AlignmentMethod::kNonConvexity, AlignmentMethod::kNonConvexitySure, [&] {
      return AlignByGraduatedNonConvexity(last, pair_.other, pair_.sd_scale);
    });
    ScoreMapper(consensus);
    return outcome_;
  }

 private:
  Answer& Of(AlignmentMethod method) { return outcome_.answers[At(method)]; }

  bool IsRight(const Alignment& alignment) const {
    return pair_.IsRight(alignment, options_.confirmation.limits.same_frame_m);
  }

  bool IsRight(const Explanation& frame) const {
    return frame.nothing_stayed() ? pair_.stayed < 2 : IsRight(frame.alignment);
  }

  void ScorePosterior() {
    const ConfirmationOptions& options = options_.confirmation;
    const double start = ThreadProcessorSeconds();
    const std::optional<Explanations> explanations =
        Explain(pair_.reference, pair_.other, pair_.area_m2, options.prior, options.limits);
    SHIFTMAP_CHECK(explanations.has_value(), "a pair has no explanations");
    Answer& answer = Of(AlignmentMethod::kPosterior);
    answer.seconds = ThreadProcessorSeconds() - start;
    best_ = explanations->best();
    outcome_.probability = best_.probability;
    outcome_.is_right = IsRight(best_);
    if (PlaceOf(std::nullopt).Decides(best_)) answer.right = outcome_.is_right;
    for (const Explanation& frame : explanations->frames) {
      if (IsRight(frame)) outcome_.of_right += frame.probability;
    }
  }

  template <typename Align>
  std::optional<Alignment> Compare(AlignmentMethod method,
                                   AlignmentMethod if_sure,
                                   const Align& align) {
    const double start = ThreadProcessorSeconds();
    const std::optional<Alignment> alignment = align();
    Answer& answer = Of(method);
    answer.seconds = ThreadProcessorSeconds() - start;
    if (alignment) answer.right = IsRight(*alignment);
    Of(if_sure).seconds = answer.seconds;
    if (!PlaceOf(alignment).NeedsConfirmation()) Of(if_sure).right = answer.right;
    return alignment;
  }

  void ScoreMapper(const std::optional<Alignment>& consensus) {
    Answer& answer = Of(AlignmentMethod::kMapper);
    answer = Of(AlignmentMethod::kConsensusSure);
    if (answer.right) return;
    answer.seconds += Of(AlignmentMethod::kPosterior).seconds;
    if (PlaceOf(consensus).Decides(best_)) answer.right = outcome_.is_right;
  }

  ConsensusPlace PlaceOf(const std::optional<Alignment>& consensus) const {
    return {options_, pair_.reference.points, pair_.area_m2, run_map_, consensus};
  }

  MapperOptions options_;
  AlignmentPair pair_;
  RunMap run_map_;    // The other map, as the mapper has it.
  Explanation best_;  // The likeliest one.
  AlignmentOutcome outcome_;
};

}  // namespace

const char* ToString(AlignmentMethod method) {
  switch (method) {
    case AlignmentMethod::kPosterior:
      return "posterior";
    case AlignmentMethod::kMapper:
      return "mapper";
    case AlignmentMethod::kConsensus:
      return "consensus";
    case AlignmentMethod::kConsistency:
      return "pairwise consistency";
    case AlignmentMethod::kNonConvexity:
      return "graduated non-convexity";
    case AlignmentMethod::kConsensusSure:
      return "consensus, sure";
    case AlignmentMethod::kConsistencySure:
      return "pairwise consistency, sure";
    case AlignmentMethod::kNonConvexitySure:
      return "graduated non-convexity, sure";
  }
  return "";
}

AlignmentOutcome AlignPair(AlignmentWorld world, std::uint64_t seed) {
  return PairScore(world, seed).Score();
}

std::vector<AlignmentOutcome> AlignPairs(AlignmentWorld world,
                                         std::uint64_t first_seed,
                                         int pairs,
                                         int threads) {
  std::vector<AlignmentOutcome> outcomes(static_cast<std::size_t>(pairs));
  ForEachIndex(outcomes.size(), threads, [&](std::size_t i) {
    outcomes[i] = AlignPair(world, first_seed + i);
  });
  return outcomes;
}

AlignmentTally TallyOf(AlignmentMethod method, const std::vector<AlignmentOutcome>& outcomes) {
  AlignmentTally tally;
  std::vector<double> seconds;
  for (const AlignmentOutcome& outcome : outcomes) {
    const Answer& answer = outcome.answers[At(method)];
    tally.pairs += 1.0;
    tally.decided += answer.right.has_value();
    tally.wrong += !answer.right.value_or(true);
    seconds.push_back(answer.seconds);
  }
  if (!seconds.empty()) tally.median_s = Median(std::move(seconds));
  return tally;
}

PosteriorTally TallyPosterior(const std::vector<AlignmentOutcome>& outcomes) {
  constexpr double kFloor = 1e-6;
  constexpr double kKept = 0.01;
  PosteriorTally tally;
  for (const AlignmentOutcome& outcome : outcomes) {
    tally.log_score +=
        std::log(std::max(kFloor, outcome.of_right)) / static_cast<double>(outcomes.size());
    if (outcome.answers[At(AlignmentMethod::kPosterior)].right) continue;
    tally.waiting += 1.0;
    tally.among_kept += outcome.of_right >= kKept;
  }
  return tally;
}

std::vector<CalibrationBin> Calibrate(const std::vector<AlignmentOutcome>& outcomes) {
  std::vector<CalibrationBin> bins;
  constexpr std::array<double, 6> kBounds = {
      0.0, 0.5, 0.9, 0.99, 0.999, std::numeric_limits<double>::infinity()};
  for (std::size_t i = 0; i + 1 < kBounds.size(); ++i) bins.push_back({kBounds[i], kBounds[i + 1]});
  for (const AlignmentOutcome& outcome : outcomes) {
    for (CalibrationBin& bin : bins) {
      if (outcome.probability < bin.low || outcome.probability >= bin.high) continue;
      bin.pairs += 1.0;
      bin.expected += outcome.probability;
      bin.right += outcome.is_right;
    }
  }
  return bins;
}

}  // namespace shiftmap
