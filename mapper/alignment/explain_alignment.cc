// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explain_alignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <map>
#include <random>

namespace shiftmap {
namespace {

// Less likely hypotheses are left out.
constexpr double kMinProbability = 1e-9;

// Of data that say nothing there are thousands of hypotheses, none of them likely. Frames beyond
// the first ones are not summed up, and where the transforms of hypotheses beyond the first ones
// lie is not looked at.
constexpr std::size_t kMaxSummed = 20;
constexpr std::size_t kMaxDrawn = 100;

// Groups whose probability of having stayed differs by this between two frames decide between them.
constexpr double kDecidingDifference = 0.5;

// Hypotheses that are one frame: the first of them is the most likely.
struct Frame {
  const Hypothesis* best = nullptr;
  double probability = 0.0;
  std::vector<double> stays;  // Per landmark, times the probability of the frame.
  std::map<MatchSet, double> sets = {};
};

// Whether two transforms place every landmark this alike.
bool AreAlike(const AlignmentEvidence& evidence,
              const SimilarityFit& x,
              const SimilarityFit& y,
              double tolerance_m) {
  for (int k = 0; k < static_cast<int>(evidence.matches().size()); ++k) {
    const Eigen::Vector2d& p = evidence.PositionInReference(k);
    if (!((x * p - y * p).norm() < tolerance_m)) return false;
  }
  return true;
}

// Draws of N(0, I), the same ones every time.
std::vector<Eigen::Vector4d> StandardDraws() {
  constexpr std::size_t kDraws = 128;
  std::mt19937_64 random(1);
  std::normal_distribution<double> normal;
  std::vector<Eigen::Vector4d> draws(kDraws);
  for (Eigen::Vector4d& z : draws) {
    for (double& value : z) value = normal(random);
  }
  return draws;
}

// Draws from the normal distribution of a transform, as many of one sign as of the other.
std::vector<SimilarityFit> Draws(const SimilarityFit& fit,
                                 const std::vector<Eigen::Vector4d>& standard) {
  const Eigen::Matrix4d root = fit.covariance.llt().matrixL();
  std::vector<SimilarityFit> draws;
  for (const Eigen::Vector4d& z : standard) {
    for (const double sign : {1.0, -1.0}) {
      const Eigen::Vector4d step = sign * (root * z);
      SimilarityFit& draw = draws.emplace_back(fit);
      draw.centre_other += step.head<2>();
      draw.yaw_rad += step[2];
      draw.log_scale += step[3];
    }
  }
  return draws;
}

void AddTo(const AlignmentEvidence& evidence,
           const Hypothesis& hypothesis,
           double probability,
           Frame* frame) {
  frame->probability += probability;
  frame->sets[hypothesis.stayed] += probability;
  for (const int k : hypothesis.stayed.Members()) {
    frame->stays[static_cast<std::size_t>(evidence.LandmarkOf(k))] += probability;
  }
}

// Each hypothesis adds to a frame what its transform, which it knows only so well, has of
// probability there; the rest is a frame of its own.
std::vector<Frame> SumToFrames(const AlignmentEvidence& evidence,
                               const std::vector<Hypothesis>& hypotheses,
                               double tolerance_m) {
  const std::vector<Eigen::Vector4d> standard = StandardDraws();
  std::vector<Frame> frames;
  for (std::size_t i = 0; i < hypotheses.size(); ++i) {
    const Hypothesis& hypothesis = hypotheses[i];
    if (hypothesis.probability < kMinProbability) break;
    double rest = hypothesis.probability;
    if (!hypothesis.stayed.empty()) {
      const std::vector<SimilarityFit> draws = i < kMaxDrawn
                                                   ? Draws(hypothesis.fit, standard)
                                                   : std::vector<SimilarityFit>{hypothesis.fit};
      const double each = hypothesis.probability / static_cast<double>(draws.size());
      for (const SimilarityFit& draw : draws) {
        const auto end =
            frames.begin() + static_cast<std::ptrdiff_t>(std::min(frames.size(), kMaxSummed));
        const auto frame = std::find_if(frames.begin(), end, [&](const Frame& known) {
          return !known.best->stayed.empty() &&
                 AreAlike(evidence, draw, known.best->fit, tolerance_m);
        });
        if (frame == end) continue;
        AddTo(evidence, hypothesis, each, &*frame);
        rest -= each;
      }
    }
    if (rest < kMinProbability) continue;
    frames.push_back({&hypothesis, 0.0, std::vector<double>(evidence.groups().size())});
    AddTo(evidence, hypothesis, rest, &frames.back());
  }
  std::stable_sort(frames.begin(), frames.end(), [](const Frame& x, const Frame& y) {
    return x.probability > y.probability;
  });
  return frames;
}

std::vector<int> GroupsOf(const AlignmentEvidence& evidence, const MatchSet& matches) {
  std::vector<int> groups;
  for (const int k : matches.Members()) groups.push_back(evidence.GroupOf(k));
  groups.erase(std::unique(groups.begin(), groups.end()), groups.end());
  return groups;
}

// The fit, from the other map to the reference.
Alignment ToReference(const AlignmentEvidence& evidence, const Hypothesis& hypothesis) {
  const SimilarityFit& fit = hypothesis.fit;
  Alignment alignment;
  const Eigen::Matrix2d R = Se2(0.0, 0.0, -fit.yaw_rad).Rotation();
  alignment.T_reference_other = Se2(fit.centre_reference - R * fit.centre_other, -fit.yaw_rad);
  alignment.signatures = GroupsOf(evidence, hypothesis.stayed);
  alignment.centroid = fit.centre_reference;
  alignment.variance_m2 = 0.5 * fit.covariance.topLeftCorner<2, 2>().trace();
  alignment.variance_rad2 = fit.covariance(2, 2);
  double squared = 0.0;
  for (const int k : hypothesis.stayed.Members()) {
    squared += (evidence.PositionInOther(k) - fit * evidence.PositionInReference(k)).squaredNorm();
  }
  alignment.rms_m = std::sqrt(squared / hypothesis.stayed.Count());
  return alignment;
}

// The sets of groups that stayed in a frame, the unlikely ones left out.
std::vector<StayedSet> AlternativesIn(const AlignmentEvidence& evidence, const Frame& frame) {
  constexpr double kUnlikely = 0.01;
  std::map<std::vector<int>, double> sets;
  for (const auto& [stayed, probability] : frame.sets) {
    sets[GroupsOf(evidence, stayed)] += probability / frame.probability;
  }
  std::erase_if(sets, [&](const auto& set) { return set.second < kUnlikely; });
  return ByFallingProbability(sets);
}

// Per group the probability that one of its landmarks stayed in a frame.
std::vector<std::pair<int, double>> StaysIn(const AlignmentEvidence& evidence, const Frame& frame) {
  std::map<int, double> stays;
  for (const int group : evidence.groups()) stays[group] = 0.0;
  for (const auto& [stayed, probability] : frame.sets) {
    for (const int group : GroupsOf(evidence, stayed)) {
      stays[group] += probability / frame.probability;
    }
  }
  return {stays.begin(), stays.end()};
}

Explanation Describe(const AlignmentEvidence& evidence, const Frame& frame) {
  Explanation explanation;
  explanation.probability = frame.probability;
  explanation.alternatives = AlternativesIn(evidence, frame);
  explanation.stays = StaysIn(evidence, frame);
  if (!frame.best->stayed.empty()) explanation.alignment = ToReference(evidence, *frame.best);
  explanation.together = GroupsOf(evidence, frame.best->together);
  for (const int k : frame.best->stayed.Members()) {
    explanation.stayed.push_back(evidence.matches()[static_cast<std::size_t>(k)]);
  }
  std::vector<int> groups = evidence.groups();
  groups.erase(std::unique(groups.begin(), groups.end()), groups.end());
  std::set_difference(groups.begin(),
                      groups.end(),
                      explanation.alignment.signatures.begin(),
                      explanation.alignment.signatures.end(),
                      std::back_inserter(explanation.moved));
  return explanation;
}

std::vector<int> Deciding(const AlignmentEvidence& evidence, const Frame& x, const Frame& y) {
  std::vector<int> deciding;
  for (std::size_t l = 0; l < evidence.groups().size(); ++l) {
    const double difference = x.stays[l] / x.probability - y.stays[l] / y.probability;
    if (std::abs(difference) > kDecidingDifference) deciding.push_back(evidence.groups()[l]);
  }
  deciding.erase(std::unique(deciding.begin(), deciding.end()), deciding.end());
  return deciding;
}

}  // namespace

std::vector<StayedSet> ByFallingProbability(const std::map<std::vector<int>, double>& sets) {
  std::vector<StayedSet> sorted;
  for (const auto& [groups, probability] : sets) sorted.push_back({groups, probability});
  std::stable_sort(sorted.begin(), sorted.end(), [](const StayedSet& x, const StayedSet& y) {
    return x.probability > y.probability;
  });
  return sorted;
}

Explanations SumToExplanations(const AlignmentEvidence& evidence,
                               const std::vector<Hypothesis>& hypotheses,
                               const ExplanationLimits& limits) {
  const std::vector<Frame> frames = SumToFrames(evidence, hypotheses, limits.same_frame_m);
  Explanations explanations;
  for (const Frame& frame : frames) {
    explanations.frames.push_back(Describe(evidence, frame));
    if (frame.best->stayed.empty()) explanations.nothing_stayed = frame.probability;
  }
  if (frames.size() > 1) explanations.deciding = Deciding(evidence, frames[0], frames[1]);
  return explanations;
}

std::optional<Explanations> Explain(const JointPoints& reference,
                                    const JointPoints& other,
                                    double area_m2,
                                    const MovePrior& prior,
                                    const ExplanationLimits& limits) {
  const AlignmentEvidence evidence(reference, other, area_m2, prior);
  if (evidence.matches().size() > kMaxMatches || evidence.groups().size() < 2) return std::nullopt;
  return SumToExplanations(evidence, SearchHypotheses(evidence, prior, limits), limits);
}

}  // namespace shiftmap
