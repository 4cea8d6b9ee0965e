// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/explain_alignment.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <bit>
#include <cmath>
#include <map>
#include <numbers>
#include <random>
#include <vector>

#include "mapper/rows.h"
#include "tests/support/random_map.h"
#include "tools/experiment/enumerate_hypotheses.h"

namespace shiftmap {
namespace {

using ::testing::IsSupersetOf;
using ::testing::SizeIs;

constexpr double kArea = 100.0;
constexpr double kDecided = 0.99;

using Groups = std::vector<GroupIndex>;

std::uint64_t Seed() { return testing::TestSeed(1); }

// Errors that neighbours share, and some of each landmark's own.
Eigen::MatrixXd Covariance(const AlignmentPoints& points, double sd_m) {
  constexpr double kLength = 4.0;
  const Eigen::Index rows = RowOf(points.size());
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(rows, rows);
  for (const ModeIndex i : points.indices()) {
    for (const ModeIndex j : points.indices()) {
      const double squared = (points[i].position - points[j].position).squaredNorm();
      const double shared = std::exp(-0.5 * squared / (kLength * kLength));
      covariance.block<2, 2>(RowOf(i), RowOf(j)) =
          sd_m * sd_m * (0.7 * shared + (i == j ? 0.3 : 0.0)) * Eigen::Matrix2d::Identity();
    }
  }
  return covariance;
}

JointPoints Points(const std::vector<Eigen::Vector2d>& positions, double sd_m) {
  JointPoints points;
  for (std::size_t i = 0; i < positions.size(); ++i) {
    points.points.push_back({GroupIndex(i), positions[i]});
  }
  points.covariance = Covariance(points.points, sd_m);
  return points;
}

void AddErrors(std::mt19937_64* random, JointPoints* points) {
  std::normal_distribution<double> normal;
  Eigen::VectorXd white(points->covariance.rows());
  for (double& value : white) value = normal(*random);
  const Eigen::MatrixXd root = points->covariance.llt().matrixL();
  const Eigen::VectorXd errors = root * white;
  for (const ModeIndex i : points->points.indices()) {
    points->points[i].position += errors.segment<2>(RowOf(i));
  }
}

JointPoints Moved(const Se2& T, double scale, JointPoints points) {
  const Eigen::Matrix2d R = scale * T.Rotation();
  for (AlignmentPoint& point : points.points) {
    point.position = T.translation() + R * point.position;
  }
  for (Eigen::Index i = 0; i + 1 < points.covariance.rows(); i += 2) {
    for (Eigen::Index j = 0; j + 1 < points.covariance.cols(); j += 2) {
      points.covariance.block<2, 2>(i, j) =
          (R * points.covariance.block<2, 2>(i, j) * R.transpose()).eval();
    }
  }
  return points;
}

// A pair of maps: a site, some landmarks of which moved on their own as the prior has it.
struct Pair {
  JointPoints reference;
  JointPoints other;
  Se2 T_other_reference;
  std::vector<int> stayed;
};

// @param rack   So many of those that moved did so as one body that stands close together.
// @param twice  So many of those that stayed stood at a second place as well while each map was
// made.
Pair DrawPair(int landmarks, int moved, std::mt19937_64* random, int rack = 0, int twice = 0) {
  std::uniform_real_distribution<double> unit;
  const double side = std::sqrt(kArea);
  const auto anywhere = [&] { return Eigen::Vector2d(side * unit(*random), side * unit(*random)); };
  std::vector<Eigen::Vector2d> before;
  for (int i = 0; i < landmarks; ++i) before.push_back(anywhere());
  std::vector<Eigen::Vector2d> after = before;
  Pair pair;
  const MovePrior prior;
  for (int i = 0; i < landmarks; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (i < landmarks - moved) {
      pair.stayed.push_back(i);
    } else if (unit(*random) >= prior.near_share) {
      after[at] = anywhere();
    } else {
      // |u|² N(u; s²I) / 2s²: the length is χ of four degrees of freedom.
      const double sd = prior.near_sd_m[static_cast<std::size_t>(4.0 * unit(*random))];
      const double length =
          sd * std::sqrt(-2.0 * std::log((1.0 - unit(*random)) * (1.0 - unit(*random))));
      const double direction = 2.0 * std::numbers::pi * unit(*random);
      after[at] += length * Eigen::Vector2d(std::cos(direction), std::sin(direction));
    }
  }
  if (rack > 0) {
    const Eigen::Vector2d corner = anywhere();
    const Se2 T_after_before(5.0 * unit(*random), 5.0 * unit(*random), 6.0 * unit(*random));
    for (int i = landmarks - rack; i < landmarks; ++i) {
      const auto at = static_cast<std::size_t>(i);
      before[at] = corner + Eigen::Vector2d(1.5 * unit(*random), 1.5 * unit(*random));
      after[at] = T_after_before * before[at];
    }
  }
  for (int i = 0; i < twice; ++i) after.push_back(before.emplace_back(anywhere()));
  pair.reference = Points(before, 0.015);
  pair.other = Points(after, 0.015);
  for (int i = 0; i < twice; ++i) {
    const ModeIndex at(landmarks + i);
    pair.reference.points[at].group = pair.other.points[at].group = GroupIndex(i);
  }
  AddErrors(random, &pair.reference);
  AddErrors(random, &pair.other);
  std::normal_distribution<double> normal;
  const Se2 T(5.0 * normal(*random), 5.0 * normal(*random), 6.0 * unit(*random));
  pair.T_other_reference = T;
  pair.other = Moved(T, std::exp(prior.sd_scale * normal(*random)), pair.other);
  return pair;
}

Explanations ExplainPair(const Pair& pair) {
  return Explain(pair.reference, pair.other, kArea, {}, {}).value();
}

// Whether a frame puts every landmark where it is, but for the scale.
bool IsRight(const Pair& pair, const Explanation& explanation) {
  if (pair.stayed.size() < 2) return explanation.nothing_stayed();
  if (explanation.nothing_stayed()) return false;
  const Se2 T = explanation.alignment.T_reference_other * pair.T_other_reference;
  return std::all_of(
      pair.reference.points.begin(), pair.reference.points.end(), [&](const AlignmentPoint& point) {
        return (T * point.position - point.position).norm() < 0.6;
      });
}

double LogDensity(const Eigen::VectorXd& r, const Eigen::LLT<Eigen::MatrixXd>& llt) {
  return -0.5 * r.dot(llt.solve(r)) - llt.matrixLLT().diagonal().array().log().sum() -
         0.5 * static_cast<double>(r.size()) * std::log(2.0 * std::numbers::pi);
}

// The oracle: a sum over a grid of transforms.
TEST(ExplainAlignmentTest, EvidenceIsTheIntegralOverTheTransform) {
  const JointPoints reference = Points({{0.0, 0.0}, {3.0, 0.5}, {1.0, 2.5}}, 0.03);
  JointPoints other = Points({{0.02, 0.01}, {3.05, 0.52}, {0.97, 2.56}}, 0.04);
  const MovePrior prior;
  const AlignmentEvidence evidence(reference, other, kArea, prior);
  const SetScore score = evidence.Score(MatchSet::OfBits(0b111));
  const Eigen::LLT<Eigen::MatrixXd> llt(reference.covariance + other.covariance);
  constexpr int kSteps = 25;
  constexpr double kReach = 5.0;
  const Eigen::Vector4d sd = score.fit.covariance.diagonal().cwiseSqrt();
  const Eigen::Vector4d step = 2.0 * kReach / kSteps * sd;
  double sum = 0.0;
  for (int i = 0; i < kSteps * kSteps * kSteps * kSteps; ++i) {
    Eigen::Vector4d x;
    int rest = i;
    for (int axis = 0; axis < 4; ++axis, rest /= kSteps) {
      x[axis] = step[axis] * (rest % kSteps - 0.5 * (kSteps - 1));
    }
    SimilarityFit fit = score.fit;
    fit.centre_other += x.head<2>();
    fit.yaw_rad += x[2];
    fit.log_scale += x[3];
    Eigen::VectorXd r(6);
    for (const MatchIndex k : evidence.matches().indices()) {
      r.segment<2>(RowOf(k)) = evidence.PositionInOther(k) - fit * evidence.PositionInReference(k);
    }
    const double z = fit.log_scale / prior.sd_scale;
    sum += std::exp(LogDensity(r, llt) - 0.5 * z * z);
  }
  const double two_pi = 2.0 * std::numbers::pi;
  const double integral = sum * step.prod() / (kArea * two_pi * prior.sd_scale * std::sqrt(two_pi));
  EXPECT_NEAR(score.log_evidence, std::log(integral), 0.05);
}

TEST(ExplainAlignmentTest, TheDensityOfAMoveIsOne) {
  const JointPoints reference = Points({{0.0, 0.0}, {3.0, 0.5}}, 0.03);
  const MovePrior prior;
  const AlignmentEvidence evidence(reference, reference, kArea, prior);
  constexpr double kStep = 0.05;
  constexpr int kReach = 400;
  double near = 0.0;
  for (int i = -kReach; i <= kReach; ++i) {
    for (int j = -kReach; j <= kReach; ++j) {
      const double log_density =
          evidence.LogMovedBy(kStep * Eigen::Vector2d(i, j), 0.01 * Eigen::Matrix2d::Identity());
      near += kStep * kStep * (std::exp(log_density) - (1.0 - prior.near_share) / kArea);
    }
  }
  EXPECT_NEAR(near, prior.near_share, 1e-3);
}

// The oracle: all subsets of ten landmarks.
TEST(ExplainAlignmentTest, SearchFindsWhatEnumerationFinds) {
  std::mt19937_64 random(Seed());
  MovePrior prior;
  prior.group_share = 0.0;
  for (int round = 0; round < 6; ++round) {
    const Pair pair = DrawPair(10, 1 + 8 * round / 5, &random);
    const AlignmentEvidence evidence(pair.reference, pair.other, kArea, prior);
    std::map<MatchSet, double> all;
    double total = 0.0;
    double best = -1e300;
    for (std::uint64_t bits = 0; bits < std::uint64_t{1} << 10; ++bits) {
      const MatchSet s = MatchSet::OfBits(bits);
      if (s.Count() >= 2) best = std::max(best, all[s] = evidence.Score(s).log_score);
    }
    for (const auto& [s, score] : all) total += std::exp(score - best);
    double found = 0.0;
    for (const Hypothesis& hypothesis : SearchHypotheses(evidence)) {
      if (!hypothesis.stayed.empty()) found += std::exp(all.at(hypothesis.stayed) - best);
    }
    EXPECT_GT(found / total, 1.0 - 1e-3) << "round " << round << ", seed " << Seed();
  }
}

// The oracle: all sets without rivals.
TEST(ExplainAlignmentTest, SearchFindsWhatEnumerationFindsOfSeveralModesInBothMaps) {
  std::mt19937_64 random(Seed());
  MovePrior prior;
  prior.group_share = 0.0;
  for (int round = 0; round < 4; ++round) {
    const Pair pair = DrawPair(6, 1 + round, &random, 0, 2);
    const AlignmentEvidence evidence(pair.reference, pair.other, kArea, prior);
    EXPECT_EQ(evidence.groups(), Groups({0, 0, 1, 1, 2, 3, 4, 5}));
    const auto matches = static_cast<int>(evidence.matches().size());
    ASSERT_EQ(matches, 4 + 2 * 4);
    const auto possible = [&](const MatchSet& s) {
      for (const MatchIndex k : s.Members()) {
        if ((s & evidence.Rivals(k)).Count() > 1) return false;
      }
      return s.Count() >= 2;
    };
    std::map<MatchSet, double> all;
    double best = -1e300;
    for (std::uint64_t bits = 0; bits < std::uint64_t{1} << matches; ++bits) {
      const MatchSet s = MatchSet::OfBits(bits);
      if (possible(s)) best = std::max(best, all[s] = evidence.Score(s).log_score);
    }
    double total = 0.0;
    for (const auto& [s, score] : all) total += std::exp(score - best);
    double found = 0.0;
    for (const Hypothesis& hypothesis : SearchHypotheses(evidence)) {
      if (hypothesis.stayed.empty()) continue;
      ASSERT_TRUE(possible(hypothesis.stayed));
      found += std::exp(all.at(hypothesis.stayed) - best);
    }
    EXPECT_GT(found / total, 1.0 - 1e-3) << "round " << round << ", seed " << Seed();
  }
}

// The oracle: all subsets of eight landmarks, each with all pairs of bodies.
TEST(ExplainAlignmentTest, ProbabilitiesOfFramesAreThoseOfEnumerationWithBodies) {
  std::mt19937_64 random(Seed());
  const MovePrior prior;
  const ExplanationLimits limits;
  for (int round = 0; round < 8; ++round) {
    const Pair pair = DrawPair(8, 5 + round % 3, &random, 3 + round % 2);
    const AlignmentEvidence evidence(pair.reference, pair.other, kArea, prior);
    const Explanations all = SumToExplanations(evidence, EnumerateHypotheses(evidence), limits);
    const Explanations found = ExplainPair(pair);
    EXPECT_NEAR(found.frames.front().probability, all.frames.front().probability, 2e-3)
        << "round " << round << ", seed " << Seed();
    EXPECT_EQ(found.frames.front().alignment.signatures, all.frames.front().alignment.signatures);
  }
}

// Five landmarks stayed, and one is elsewhere by a few standard deviations: the frame is sure, and
// not whether that landmark stayed. The oracle: the sum over all sets.
TEST(ExplainAlignmentTest, AlternativesOfOneFrameAreThoseOfEnumeration) {
  constexpr int kInDoubt = 5;
  int ambiguous = 0;
  for (int step = 0; step < 8; ++step) {
    std::vector<Eigen::Vector2d> places = {
        {0.0, 0.0}, {6.0, 0.5}, {5.5, 5.0}, {0.5, 6.0}, {3.0, 2.0}, {2.0, 4.5}};
    const JointPoints reference = Points(places, 0.05);
    places[kInDoubt].x() += 0.1 + 0.04 * step;
    const JointPoints other = Points(places, 0.05);
    const MovePrior prior;
    const AlignmentEvidence evidence(reference, other, kArea, prior);
    std::map<MatchSet, double> sets;
    double in_frame = 0.0;
    double stayed = 0.0;
    for (const Hypothesis& hypothesis : EnumerateHypotheses(evidence)) {
      if (hypothesis.stayed.empty()) continue;
      sets[hypothesis.stayed] += hypothesis.probability;
      in_frame += hypothesis.probability;
      if (hypothesis.stayed.Contains(MatchIndex(kInDoubt))) stayed += hypothesis.probability;
    }
    const Explanation best = Explain(reference, other, kArea, prior, {}).value().frames.front();
    ASSERT_GT(best.probability, kDecided);
    ASSERT_THAT(best.given.stays, SizeIs(places.size()));
    EXPECT_NEAR(best.given.stays[kInDoubt].second, stayed / in_frame, 0.01);
    ASSERT_FALSE(best.given.alternatives.empty());
    double sum = 0.0;
    for (const StayedSet& set : best.given.alternatives) {
      MatchSet stayed_set;  // Each landmark has one mode.
      for (const GroupIndex group : set.groups) {
        stayed_set = stayed_set.Flipped(MatchIndex(group.value()));
      }
      EXPECT_NEAR(set.probability, sets.at(stayed_set) / in_frame, 0.01);
      sum += set.probability;
    }
    EXPECT_GT(sum, 0.9);
    ambiguous +=
        best.given.stays[kInDoubt].second > 0.05 && best.given.stays[kInDoubt].second < 0.95 ? 1
                                                                                             : 0;
  }
  EXPECT_GE(ambiguous, 2);
}

// Four places of two landmarks mostly decide where all others stand elsewhere.
TEST(ExplainAlignmentTest, WhereALandmarkStoodAtTwoTimesIsTwoPlaces) {
  std::mt19937_64 random(Seed());
  int decided = 0;
  for (int round = 0; round < 20; ++round) {
    const Pair pair = DrawPair(10, 8, &random, 0, 2);
    const Explanation best = ExplainPair(pair).frames.front();
    if (best.probability < kDecided) continue;
    ++decided;
    EXPECT_TRUE(IsRight(pair, best)) << "round " << round << ", seed " << Seed();
    EXPECT_THAT(best.alignment.signatures, IsSupersetOf(Groups({0, 1})));
    EXPECT_THAT(best.moved, SizeIs(10 - best.alignment.signatures.size()));
    EXPECT_GE(best.stayed.size(), 4);
    for (const Match& match : best.stayed) EXPECT_EQ(match.reference, match.other);
  }
  EXPECT_GE(decided, 12);
}

TEST(ExplainAlignmentTest, GainsAreWhatSingleChangesDo) {
  std::mt19937_64 random(Seed());
  const Pair pair = DrawPair(8, 0, &random);
  const MovePrior prior;
  const AlignmentEvidence evidence(pair.reference, pair.other, kArea, prior);
  const MatchSet kSet = MatchSet::OfBits(0b00011101);
  IndexedVector<MatchIndex, double> gains;
  const SetScore score = evidence.Score(kSet, &gains);
  // Adding one leaves the predictions of the others about as they were.
  const SetScore without = evidence.Score(kSet.Flipped(0));
  const double sum_of_gains = evidence.Score(kSet).log_score - without.log_score;
  double others = 0.0;
  for (const LandmarkIndex l : std::vector<LandmarkIndex>{1, 5, 6, 7})
    others += score.log_moved[l] - without.log_moved[l];
  EXPECT_NEAR(-gains[0], sum_of_gains - others, 1e-2);
}

TEST(ExplainAlignmentTest, DoesNotDependOnFramesNorOnOrder) {
  std::mt19937_64 random(Seed());
  for (int round = 0; round < 5; ++round) {
    const Pair pair = DrawPair(12, 8, &random);
    const Explanations once = ExplainPair(pair);
    JointPoints reference = Moved(Se2(3.0, -7.0, 2.5), 1.0, pair.reference);
    JointPoints other = Moved(Se2(-30.0, 8.0, -1.0), 1.0, pair.other);
    std::vector<Eigen::Index> rows;
    AlignmentPoints points;
    for (ModeIndex i = other.points.end_index() - 1; i >= 0; i = i - 1) {
      points.push_back(other.points[i]);
      rows.insert(rows.end(), {RowOf(i), RowOf(i) + 1});
    }
    other = {points, other.covariance(rows, rows)};
    const Explanations moved = Explain(reference, other, kArea, {}, {}).value();
    ASSERT_FALSE(moved.frames.empty());
    EXPECT_NEAR(once.frames[0].probability, moved.frames[0].probability, 1e-2);
    EXPECT_EQ(once.frames[0].alignment.signatures, moved.frames[0].alignment.signatures);
    EXPECT_EQ(once.deciding, moved.deciding);
  }
}

TEST(ExplainAlignmentTest, OtherUnitsOfLengthChangeNothing) {
  constexpr double kFeet = 3.28;
  std::mt19937_64 random(Seed());
  const Pair pair = DrawPair(12, 8, &random);
  MovePrior prior;
  for (double& sd : prior.near_sd_m) sd *= kFeet;
  ExplanationLimits limits;
  limits.same_frame_m *= kFeet;
  const Explanations once = ExplainPair(pair);
  const Explanations scaled = Explain(Moved(Se2(), kFeet, pair.reference),
                                      Moved(Se2(), kFeet, pair.other),
                                      kFeet * kFeet * kArea,
                                      prior,
                                      limits)
                                  .value();
  EXPECT_NEAR(once.frames[0].probability, scaled.frames[0].probability, 1e-2);
  EXPECT_EQ(once.frames[0].alignment.signatures, scaled.frames[0].alignment.signatures);
}

TEST(ExplainAlignmentTest, LandmarksThatAllStayedAreDecided) {
  std::mt19937_64 random(Seed());
  for (const int landmarks : {5, 10, 30}) {
    const Pair pair = DrawPair(landmarks, 0, &random);
    const Explanations explanations = ExplainPair(pair);
    EXPECT_GT(explanations.frames[0].probability, kDecided) << landmarks;
    EXPECT_TRUE(IsRight(pair, explanations.frames[0])) << landmarks;
  }
}

// The oracle: pairs that are drawn from the prior. A probability is then how often it is right.
TEST(ExplainAlignmentTest, ProbabilitiesAreFrequenciesWhereThePriorIsRight) {
  constexpr int kPairs = 600;
  MovePrior prior;
  prior.group_share = 0.0;
  std::mt19937_64 random(Seed());
  std::uniform_real_distribution<double> unit;
  int decided = 0;
  int wrong = 0;
  double expected = 0.0;
  double variance = 0.0;
  int right = 0;
  for (int i = 0; i < kPairs; ++i) {
    const int landmarks = 5 + i % 10;
    const bool none = unit(random) < prior.none_stayed;
    const int least = none ? 0 : 2;
    const int most = none ? 1 : landmarks;
    const int stayed = std::uniform_int_distribution(least, most)(random);
    const Pair pair = DrawPair(landmarks, landmarks - stayed, &random);
    const Explanation best =
        Explain(pair.reference, pair.other, kArea, prior, {}).value().frames.front();
    const bool is_right = IsRight(pair, best);
    right += is_right;
    expected += best.probability;
    variance += best.probability * (1.0 - best.probability);
    if (best.nothing_stayed() || best.probability < kDecided) continue;
    ++decided;
    wrong += !is_right;
  }
  RecordProperty("decided", decided);
  RecordProperty("wrong", wrong);
  RecordProperty("right", right);
  RecordProperty("expected", fmt::format("{:.1f}", expected));
  EXPECT_GT(decided, kPairs / 3);
  EXPECT_LE(wrong, 0.01 * decided + 3.0 * std::sqrt(0.01 * decided));
  EXPECT_NEAR(right, expected, 4.0 * std::sqrt(variance));
}

// A rack with several landmarks that is moved agrees with itself as what stayed does.
TEST(ExplainAlignmentTest, ARackThatMovesIsRarelyTakenForWhatStayed) {
  constexpr int kPairs = 400;
  std::mt19937_64 random(Seed());
  std::uniform_real_distribution<double> unit;
  int decided = 0;
  int wrong = 0;
  for (int i = 0; i < kPairs; ++i) {
    constexpr int kLandmarks = 15;
    const int stayed = std::uniform_int_distribution(2, 8)(random);
    const int size = std::uniform_int_distribution(3, 6)(random);
    const Pair pair = DrawPair(kLandmarks, kLandmarks - stayed, &random, size);
    const Explanation best = ExplainPair(pair).frames.front();
    if (best.nothing_stayed() || best.probability < kDecided) continue;
    ++decided;
    wrong += !IsRight(pair, best);
  }
  RecordProperty("decided", decided);
  RecordProperty("wrong", wrong);
  EXPECT_GT(decided, kPairs / 4);
  EXPECT_LE(wrong, 0.02 * decided);
}

// A square that may have been turned by a quarter: labels say that it was not.
TEST(ExplainAlignmentTest, TwoBodiesOfOneSizeAreTwoExplanations) {
  const std::vector<Eigen::Vector2d> before = {{0.0, 0.0},
                                               {1.0, 0.2},
                                               {0.3, 1.1},
                                               {1.4, 1.3},
                                               {6.0, 0.0},
                                               {7.1, 0.4},
                                               {6.2, 1.4},
                                               {7.3, 0.9}};
  std::vector<Eigen::Vector2d> after = before;
  for (std::size_t i = 4; i < after.size(); ++i) after[i] += Eigen::Vector2d(0.5, 1.2);
  const Explanations explanations =
      Explain(Points(before, 0.01), Points(after, 0.01), kArea, {}, {}).value();
  ASSERT_GE(explanations.frames.size(), 2U);
  EXPECT_LT(explanations.frames[0].probability, 0.6);
  EXPECT_NEAR(explanations.frames[0].probability, explanations.frames[1].probability, 0.15);
  EXPECT_EQ(explanations.deciding, Groups({0, 1, 2, 3, 4, 5, 6, 7}));
}

// Barriers that stand apart may be displaced together: that the four which agree stayed is likelier
// than that the other two did, but not certain.
TEST(ExplainAlignmentTest, ThatFourOfSixStayedIsNotCertain) {
  std::mt19937_64 random(Seed());
  std::uniform_real_distribution<double> unit(0.0, std::sqrt(kArea));
  for (int i = 0; i < 50; ++i) {
    std::vector<Eigen::Vector2d> before(6);
    for (Eigen::Vector2d& p : before) p = {unit(random), unit(random)};
    std::vector<Eigen::Vector2d> after = before;
    for (std::size_t k = 2; k < 6; ++k) after[k] += Eigen::Vector2d(0.8, 0.6);
    JointPoints reference = Points(before, 0.03);
    JointPoints other = Points(after, 0.03);
    AddErrors(&random, &reference);
    AddErrors(&random, &other);
    const Explanations found = *Explain(reference, other, kArea, MovePrior(), ExplanationLimits());
    double two_stayed = 0.0;
    for (const Explanation& frame : found.frames) {
      if (frame.alignment.signatures == Groups({0, 1})) two_stayed += frame.probability;
    }
    EXPECT_GT(two_stayed, 1e-3);
    EXPECT_LT(two_stayed, 0.99);
  }
}

// Each of two racks that moved has more landmarks than stayed. That a rack stayed leaves three
// bodies, one of which is not compact.
TEST(ExplainAlignmentTest, TwoRacksThatMovedAreTwoBodies) {
  const std::vector<Eigen::Vector2d> rack = {
      {0.0, 0.0}, {0.9, 0.1}, {0.3, 0.8}, {1.1, 1.0}, {0.5, 0.4}};
  std::vector<Eigen::Vector2d> before = {{0.5, 1.0}, {2.1, 9.0}, {9.3, 8.2}, {8.8, 0.7}};
  std::vector<Eigen::Vector2d> after = before;
  for (const Eigen::Vector2d& offset : rack) {
    before.push_back(Eigen::Vector2d(2.0, 3.0) + offset);
    after.push_back(Se2(3.5, 6.0, 0.3) * offset);
  }
  for (const Eigen::Vector2d& offset : rack) {
    before.push_back(Eigen::Vector2d(7.0, 4.0) - offset);
    after.push_back(Se2(6.0, 2.0, 2.5) * offset);
  }
  const Explanations explanations =
      Explain(Points(before, 0.01), Points(after, 0.01), kArea, {}, {}).value();
  EXPECT_EQ(explanations.frames[0].alignment.signatures, Groups({0, 1, 2, 3}));
  EXPECT_GT(explanations.frames[0].probability, 0.9);
}

// By a half turn about the middle between them two racks change places as one body does.
class SwappedRacksTest : public ::testing::Test {
 protected:
  static constexpr double kSide = 20.0;

  // @param stayed  Of eight other landmarks.
  Explanations ExplainSwap(std::size_t stayed, double turn_rad, const MovePrior& prior = {}) const {
    std::vector<Eigen::Vector2d> before = {{1.0, 2.0},
                                           {18.2, 8.0},
                                           {4.2, 18.0},
                                           {18.6, 16.4},
                                           {10.4, 0.8},
                                           {0.4, 11.0},
                                           {13.2, 19.2},
                                           {17.6, 1.4}};
    const std::vector<Eigen::Vector2d> moves = {
        {-2.4, 3.1}, {4.2, 0.9}, {-0.7, -5.1}, {3.3, 3.2}, {-4.5, 0.2}, {1.2, -3.6}};
    std::vector<Eigen::Vector2d> after = before;
    for (std::size_t i = stayed; i < after.size(); ++i) after[i] += moves[i - stayed];
    const Eigen::Vector2d centres[] = {{5.0, 7.0}, {14.0, 12.0}};
    const Eigen::Matrix2d R = Se2(0.0, 0.0, turn_rad).Rotation();
    for (const int rack : {0, 1}) {
      for (const Eigen::Vector2d& offset : kRack) {
        before.emplace_back(centres[rack] + offset);
        after.emplace_back(centres[1 - rack] + R * offset);
      }
    }
    return Explain(Points(before, 0.01), Points(after, 0.01), kSide * kSide, prior, {}).value();
  }

  const std::vector<Eigen::Vector2d> kRack = {
      {-0.6, -0.5}, {0.5, -0.4}, {-0.3, 0.4}, {0.6, 0.5}, {0.0, 0.1}};
};

TEST_F(SwappedRacksTest, AreNotTakenForWhatStayed) {
  for (const double turn_rad : {0.0, std::numbers::pi}) {
    for (const std::size_t stayed : {2U, 3U, 4U, 5U}) {
      const Explanation best = ExplainSwap(stayed, turn_rad).frames.front();
      const bool is_right = !best.alignment.signatures.empty() &&
                            best.alignment.signatures.front() == 0 &&
                            best.alignment.signatures.back() < 8;
      EXPECT_TRUE(is_right || best.probability < kDecided)
          << stayed << " stayed, turned by " << turn_rad << ": " << best.probability;
    }
  }
}

TEST_F(SwappedRacksTest, AreTwoBodiesWhereFiveOthersStayed) {
  for (const double turn_rad : {0.0, std::numbers::pi}) {
    const Explanation best = ExplainSwap(5, turn_rad).frames.front();
    EXPECT_GT(best.probability, kDecided) << turn_rad;
    EXPECT_EQ(best.alignment.signatures, Groups({0, 1, 2, 3, 4})) << turn_rad;
  }
}

TEST_F(SwappedRacksTest, WhatIsAssumedOfBodiesThatMoveDecides) {
  for (double MovePrior::*sd : {&MovePrior::same_heading_sd_rad,
                                &MovePrior::slot_sd_m,
                                &MovePrior::exchange_sd_m,
                                &MovePrior::exchange_heading_sd_rad}) {
    MovePrior prior;
    prior.*sd *= 10.0;
    double change = 0.0;
    for (const double turn_rad : {0.1, 0.3, 1.0}) {
      change += std::abs(ExplainSwap(2, turn_rad, prior).frames.front().probability -
                         ExplainSwap(2, turn_rad).frames.front().probability);
    }
    EXPECT_GT(change, 1e-6);
  }
}

// Landmarks of the reference may have several modes, and stay at any.
TEST(ExplainAlignmentTest, LandmarksStayAtAnyOfTheirModes) {
  std::mt19937_64 random(Seed());
  Pair pair = DrawPair(8, 0, &random);
  const Explanations single = ExplainPair(pair);
  // Where landmarks stood at another time.
  AlignmentPoints points = pair.reference.points;
  for (const ModeIndex i : std::vector<ModeIndex>{1, 4, 6}) {
    const AlignmentPoint& point = pair.reference.points[i];
    points.push_back({point.group, point.position + Eigen::Vector2d(1.5, -0.8)});
  }
  pair.reference = {points, Covariance(points, 0.015)};
  const Explanations several = ExplainPair(pair);
  EXPECT_GT(several.frames[0].probability, kDecided);
  EXPECT_EQ(several.frames[0].alignment.signatures, single.frames[0].alignment.signatures);
  EXPECT_TRUE(IsRight(pair, several.frames[0]));
}

TEST(ExplainAlignmentTest, TooManyMatchesAreNotExplained) {
  std::mt19937_64 random(Seed());
  EXPECT_FALSE(Explain(Points({{0.0, 0.0}}, 0.01), Points({{0.0, 0.0}}, 0.01), kArea, {}, {}));
  const Pair pair = DrawPair(kMaxMatches + 1, 0, &random);
  EXPECT_FALSE(Explain(pair.reference, pair.other, kArea, {}, {}));
}

}  // namespace
}  // namespace shiftmap
