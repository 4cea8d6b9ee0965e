// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/enumerate_hypotheses.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "localizer/hypothesis/log_math.h"
#include "mapper/alignment/moved_bodies.h"
#include "mapper/alignment/rigid_bodies.h"
#include "proto/core/check.h"

namespace shiftmap {
namespace {

constexpr double kNegligibleSet = 30.0;  // [nats]
constexpr std::size_t kMaxLandmarks = 20;

// All lists of at most two bodies beside what stayed.
double LogBodies(const MovedBodies& none, const MatchSet& stayed, const std::vector<Body>& bodies) {
  double total = none.LogScore();
  for (std::size_t i = 0; i < bodies.size(); ++i) {
    if (bodies[i].matches.Intersects(stayed)) continue;
    const MovedBodies one = none.With(bodies[i]);
    total = LogAdd(total, one.LogScore());
    for (std::size_t j = i + 1; j < bodies.size(); ++j) {
      if (bodies[j].matches.Intersects(stayed | bodies[i].matches)) continue;
      total = LogAdd(total, one.With(bodies[j]).LogScore());
    }
  }
  return total;
}

}  // namespace

std::vector<Hypothesis> EnumerateHypotheses(const AlignmentEvidence& evidence) {
  const std::size_t landmarks = evidence.groups().size();
  SHIFTMAP_CHECK(landmarks <= kMaxLandmarks && evidence.matches().size() == landmarks,
                 "too many sets");
  const RigidBodies rigid(evidence);
  std::vector<std::pair<MatchSet, SetScore>> sets;
  std::vector<Body> bodies;
  double best = kLogZero;
  for (std::uint64_t bits = 0; bits < std::uint64_t{1} << landmarks; ++bits) {
    const MatchSet set = MatchSet::OfBits(bits);
    const int count = set.Count();
    if (count < 2) continue;
    SetScore score = evidence.Score(set);
    const bool may_be_body = evidence.prior().group_share > 0.0 && count >= RigidBodies::kMinSize;
    if (may_be_body && score.log_evidence + rigid.LogProbability(set) >
                           count * evidence.log_anywhere() - kNegligibleSet) {
      bodies.push_back({set, score.fit, score.log_evidence, rigid.ScatteredShare(set)});
    }
    best = std::max(best, score.log_score);
    if (score.log_score > best - kNegligibleSet) sets.emplace_back(set, std::move(score));
  }
  std::vector<Hypothesis> found;
  for (const Hypothesis& hypothesis : SearchHypotheses(evidence)) {
    if (hypothesis.stayed.empty()) found.push_back(hypothesis);
  }
  for (auto& [set, score] : sets) {
    const StayedLandmarks stayed{set, &score.fit, std::move(score.log_moved)};
    const double log_score = score.log_score - evidence.LogStaying(set.Count()) +
                             LogBodies(MovedBodies(evidence, rigid, stayed), set, bodies);
    found.push_back({set, score.fit, log_score, 0.0});
  }
  NormalizeAndSort(&found);
  return found;
}

}  // namespace shiftmap
