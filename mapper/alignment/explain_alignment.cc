// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explain_alignment.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <random>
#include <utility>

namespace shiftmap {
namespace {

// Less likely hypotheses are left out.
constexpr double kMinProbability = 1e-9;

// Of data that say nothing there are thousands of hypotheses, none of them likely. Frames beyond
// the first ones are not summed up, and where the transforms of hypotheses beyond the first ones
// lie is not looked at.
constexpr std::size_t kMaxSummed = 20;
constexpr std::size_t kMaxDrawn = 100;

// Hypotheses that are one frame: the first of them is the most likely.
struct Frame {
  const Hypothesis* best = nullptr;
  StayedSets sets;
};

// Whether two transforms place every landmark this alike.
bool AreAlike(const AlignmentEvidence& evidence,
              const SimilarityFit& x,
              const SimilarityFit& y,
              double tolerance_m) {
  for (const MatchIndex k : evidence.matches().indices()) {
    const Eigen::Vector2d& p = evidence.PositionInReference(k);
    if (!((x * p - y * p).norm() < tolerance_m)) return false;
  }
  return true;
}

// Draws of N(0, I), the same ones every time.
std::vector<Eigen::Vector4d> StandardDraws() {
  constexpr std::size_t kDraws = 128;  // Shares of a hypothesis are known to 1 / 128.
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

std::vector<GroupIndex> GroupsOf(const AlignmentEvidence& evidence, const MatchSet& matches) {
  std::vector<GroupIndex> groups;
  for (const MatchIndex k : matches.Members()) groups.push_back(evidence.GroupOf(k));
  groups.erase(std::unique(groups.begin(), groups.end()), groups.end());
  return groups;
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
    const std::vector<GroupIndex> groups = GroupsOf(evidence, hypothesis.stayed);
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
        frame->sets[groups] += each;
        rest -= each;
      }
    }
    if (rest < kMinProbability) continue;
    frames.push_back({&hypothesis, {{groups, rest}}});
  }
  return frames;
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
  return alignment;
}

Explanation Describe(const AlignmentEvidence& evidence, const Frame& frame) {
  Explanation explanation =
      DescribeFrame(frame.sets, GroupsOf(evidence, frame.best->stayed), evidence.groups());
  if (!frame.best->stayed.empty()) explanation.alignment = ToReference(evidence, *frame.best);
  for (const MatchIndex k : frame.best->stayed.Members()) {
    explanation.stayed.push_back(evidence.matches()[k]);
  }
  return explanation;
}

}  // namespace

Explanations SumToExplanations(const AlignmentEvidence& evidence,
                               const std::vector<Hypothesis>& hypotheses,
                               const ExplanationLimits& limits) {
  std::vector<Explanation> frames;
  for (const Frame& frame : SumToFrames(evidence, hypotheses, limits.same_frame_m)) {
    frames.push_back(Describe(evidence, frame));
  }
  return DescribeFrames(std::move(frames));
}

std::optional<Explanations> Explain(const JointPoints& reference,
                                    const JointPoints& other,
                                    double area_m2,
                                    const MovePrior& prior,
                                    const ExplanationLimits& limits) {
  const AlignmentEvidence evidence(reference, other, area_m2, prior);
  if (evidence.matches().size() > kMaxMatches || evidence.groups().size() < 2) return std::nullopt;
  return SumToExplanations(evidence, SearchHypotheses(evidence), limits);
}

}  // namespace shiftmap
