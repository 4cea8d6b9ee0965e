// SPDX-License-Identifier: Apache-2.0
#include "mapper/alignment/rigid_bodies.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <vector>

namespace shiftmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using ::testing::SizeIs;

constexpr double kArea = 200.0;

// Of four landmarks apart, and of as many in a rack.
const std::vector<Eigen::Vector2d> kApart = {{1.0, 1.5}, {12.0, 2.0}, {3.0, 11.0}, {13.5, 12.0}};
const std::vector<Eigen::Vector2d> kRack = {{7.0, 6.0}, {7.6, 6.3}, {6.8, 6.7}, {7.3, 6.9}};

// Two maps with the landmarks at the same places.
class Site {
 public:
  explicit Site(const std::vector<Eigen::Vector2d>& places) {
    for (std::size_t i = 0; i < places.size(); ++i) {
      map_.points.push_back({GroupIndex(i), places[i]});
    }
    const auto rows = static_cast<Eigen::Index>(2 * places.size());
    map_.covariance = 4e-4 * Eigen::MatrixXd::Identity(rows, rows);
  }

  AlignmentEvidence Evidence() const { return {map_, map_, kArea, prior_}; }
  const MovePrior& prior() const { return prior_; }

 private:
  JointPoints map_;
  MovePrior prior_;
};

std::vector<Eigen::Vector2d> Together(const std::vector<Eigen::Vector2d>& a,
                                      const std::vector<Eigen::Vector2d>& b) {
  std::vector<Eigen::Vector2d> all = a;
  all.insert(all.end(), b.begin(), b.end());
  return all;
}

// The sum of the prior over all sets of two and more that stayed, with each of some bodies moved
// beside them or none.
double SumOfPrior(const AlignmentEvidence& evidence,
                  const RigidBodies& rigid,
                  const std::vector<MatchSet>& bodies) {
  double sum = 0.0;
  const std::size_t landmarks = evidence.groups().size();
  for (std::uint64_t bits = 0; bits < std::uint64_t{1} << landmarks; ++bits) {
    const MatchSet stayed = MatchSet::OfBits(bits);
    if (stayed.Count() < 2) continue;
    sum += std::exp(rigid.LogStaying(stayed, {}));
    for (const MatchSet& body : bodies) {
      if (!body.Intersects(stayed)) sum += std::exp(rigid.LogStaying(stayed, {body}));
    }
  }
  return sum;
}

TEST(RigidBodiesTest, LandmarksThatStandCloseTogetherAreABody) {
  const Site site(Together(kApart, kRack));
  const AlignmentEvidence evidence = site.Evidence();
  const RigidBodies rigid(evidence);
  EXPECT_THAT(rigid.clusters(), ElementsAre(MatchSet::OfBits(0b11110000)));
  EXPECT_GT(rigid.LogProbability(MatchSet::OfBits(0b11110000)), std::log(0.8));
  EXPECT_LT(rigid.LogProbability(MatchSet::OfBits(0b00001111)), std::log(2e-5));
  EXPECT_LT(rigid.LogProbability(MatchSet::OfBits(0b01110000)), std::log(0.2));
}

TEST(RigidBodiesTest, WithoutBodiesThePriorIsThatOfSingleLandmarks) {
  const Site site(kApart);
  const AlignmentEvidence evidence = site.Evidence();
  const RigidBodies rigid(evidence);
  ASSERT_THAT(rigid.clusters(), IsEmpty());
  for (const std::uint64_t bits : {0b0011U, 0b0111U, 0b1111U}) {
    const MatchSet stayed = MatchSet::OfBits(bits);
    EXPECT_NEAR(rigid.LogStaying(stayed, {}), evidence.LogStaying(stayed.Count()), 1e-9);
  }
  EXPECT_NEAR(SumOfPrior(evidence, rigid, {}), 1.0 - site.prior().none_stayed, 1e-9);
}

TEST(RigidBodiesTest, ThePriorOfABodyThatStaysMovesOrFallsApartIsAboutOne) {
  const Site site(Together(kApart, kRack));
  const AlignmentEvidence evidence = site.Evidence();
  const RigidBodies rigid(evidence);
  ASSERT_THAT(rigid.clusters(), SizeIs(1));
  EXPECT_NEAR(SumOfPrior(evidence, rigid, rigid.clusters()), 1.0, 0.1);
}

// A rack is one thing that stays: as few as one more landmark elsewhere.
TEST(RigidBodiesTest, ARackThatStaysIsOneThingThatStays) {
  const Site site(Together(kApart, kRack));
  const AlignmentEvidence evidence = site.Evidence();
  const RigidBodies rigid(evidence);
  const double rack = rigid.LogStaying(MatchSet::OfBits(0b11110001), {});
  const double others = rigid.LogStaying(MatchSet::OfBits(0b00000011), rigid.clusters());
  EXPECT_NEAR(rack, others, 0.2);
  EXPECT_GT(rack, evidence.LogStaying(5) + 1.5);
}

}  // namespace
}  // namespace shiftmap
