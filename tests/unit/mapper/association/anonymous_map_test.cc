// SPDX-License-Identifier: Apache-2.0
//
// Landmarks without signature through the whole mapper.
#include <gtest/gtest.h>

#include <algorithm>

#include "mapper/association/anonymous_landmarks.h"
#include "mapper/mapper.h"
#include "tests/unit/mapper/association/anonymous_world.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// Twelve landmarks that keep their signature, the rest lose it; nothing moves.
struct Site {
  SimulatedWorld world;
  std::vector<Signature> keep;
  std::vector<MapperInput> inputs;
};

Site MakeSite(int runs, std::size_t named) {
  OpenWorldOptions options;
  options.seed = 11;
  options.groups = 30;
  options.modes_per_group = 1;
  options.size_m = 30.0;
  options.runs = runs;
  options.duration_s = 240.0;
  options.mode_change_probability = 0.0;
  Site site{testing::Simulate(options), {}, {}};
  const std::vector<Signature> all = testing::SignaturesOf(site.world);
  site.keep.assign(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(named));
  site.inputs = testing::Inputs(site.world);
  for (std::size_t i = 0; i < site.inputs.size(); ++i) {
    site.inputs[i].run = testing::Anonymize(site.inputs[i].run, site.keep, 0.1, i).run;
  }
  return site;
}

MapperOptions Associating() {
  MapperOptions options;
  options.association.associate = true;
  return options;
}

// Landmarks that lost their signature and were seen often enough, and the worst error of those of
// the map after the best rigid alignment to them; -1 if one is nowhere near.
double WorstError(const Site& site, const std::vector<Mode>& landmarks) {
  std::vector<Eigen::Vector2d> truth;
  for (const SimulatedGroup& group : site.world.groups) truth.push_back(group.modes.front());
  const Se2 T_map_world = site.world.runs.front().truth.front().T_map_vehicle.Inverse();
  std::vector<PointPair> pairs;
  for (const Mode& landmark : landmarks) {
    PointPair best{truth.front(), landmark.p_map_landmark};
    for (const Eigen::Vector2d& p : truth) {
      if ((T_map_world * p - best.p_b).norm() < (T_map_world * best.p_a - best.p_b).norm()) {
        best.p_a = p;
      }
    }
    if ((T_map_world * best.p_a - best.p_b).norm() > 1.0) return -1.0;
    pairs.push_back(best);
  }
  const StatusOr<Se2> T = AlignRigid2d(pairs);
  double worst = 0.0;
  for (const PointPair& pair : pairs) worst = std::max(worst, (pair.p_a - *T * pair.p_b).norm());
  return worst;
}

TEST(AnonymousMap, AreLeftOutUnlessAskedFor) {
  const Site site = MakeSite(1, 12);
  const StatusOr<MapperResult> result = BuildMap(site.inputs, std::nullopt, {});
  ASSERT_TRUE(result.ok());
  EXPECT_TRUE(result->content.anonymous_landmarks.empty());
  EXPECT_LE(result->content.groups.size(), 12U);
}

TEST(AnonymousMap, StandBesideTheGroups) {
  const Site site = MakeSite(1, 12);
  const StatusOr<MapperResult> result = BuildMap(site.inputs, std::nullopt, Associating());
  ASSERT_TRUE(result.ok()) << Message(result.status());
  const MapContent& content = result->content;
  EXPECT_LE(content.groups.size(), 12U);
  for (const LandmarkGroup& group : content.groups) {
    EXPECT_NE(std::find(site.keep.begin(), site.keep.end(), group.signature), site.keep.end());
  }
  EXPECT_NEAR(static_cast<double>(content.anonymous_landmarks.size()), 17.0, 2.0);
  const double worst = WorstError(site, content.anonymous_landmarks);
  EXPECT_GE(worst, 0.0);
  EXPECT_LT(worst, 0.4);
  for (std::size_t i = 0; i < content.anonymous_landmarks.size(); ++i) {
    EXPECT_EQ(content.anonymous_landmarks[i].number, ModeNumber(static_cast<int>(i) + 1));
  }
}

TEST(AnonymousMap, NeedsNoSignatureAtAllInOneRun) {
  const Site site = MakeSite(1, 0);
  const StatusOr<MapperResult> result = BuildMap(site.inputs, std::nullopt, Associating());
  ASSERT_TRUE(result.ok()) << Message(result.status());
  EXPECT_TRUE(result->content.groups.empty());
  EXPECT_NEAR(static_cast<double>(result->content.anonymous_landmarks.size()), 29.0, 3.0);
  EXPECT_GE(WorstError(site, result->content.anonymous_landmarks), 0.0);

  // Neither a second run of that kind nor one onto that map has anything to be aligned by.
  const StatusOr<MapperResult> onto = BuildMap(site.inputs, result->content, Associating());
  EXPECT_EQ(onto.status().code(), StatusCode::kInvalidArgument);
  EXPECT_NE(Message(onto.status()).find("none with a signature"), std::string::npos);
  const Site two = MakeSite(2, 0);
  const StatusOr<MapperResult> both = BuildMap(two.inputs, std::nullopt, Associating());
  ASSERT_TRUE(both.ok());
  EXPECT_EQ(both->runs.size(), 1U);
  EXPECT_EQ(both->rejected.size(), 1U);
}

TEST(AnonymousMap, RunsShareThemOnceSignaturesAlignThem) {
  const Site site = MakeSite(2, 12);
  const StatusOr<MapperResult> both = BuildMap(site.inputs, std::nullopt, Associating());
  ASSERT_TRUE(both.ok()) << Message(both.status());
  ASSERT_EQ(both->runs.size(), 2U);
  EXPECT_NEAR(static_cast<double>(both->content.anonymous_landmarks.size()), 18.0, 2.0);
  EXPECT_GE(WorstError(site, both->content.anonymous_landmarks), 0.0);

  // One after the other, the second night onto the map of the first.
  const StatusOr<MapperResult> first = BuildMap({site.inputs[0]}, std::nullopt, Associating());
  ASSERT_TRUE(first.ok());
  const StatusOr<MapperResult> second = BuildMap({site.inputs[1]}, first->content, Associating());
  ASSERT_TRUE(second.ok()) << Message(second.status());
  const std::vector<Mode>& before = first->content.anonymous_landmarks;
  const std::vector<Mode>& after = second->content.anonymous_landmarks;
  EXPECT_NEAR(static_cast<double>(after.size()), 18.0, 2.0);
  ASSERT_GE(after.size(), before.size());
  int seen_again = 0;
  for (std::size_t i = 0; i < before.size(); ++i) {
    EXPECT_EQ(after[i].number, before[i].number);
    EXPECT_LT((after[i].p_map_landmark - before[i].p_map_landmark).norm(), 0.5);
    seen_again += after[i].last_seen > before[i].last_seen;
  }
  EXPECT_GE(seen_again + 2, static_cast<int>(before.size()));
}

TEST(AnonymousMap, DoesNotDependOnTheOrderOfRuns) {
  const Site site = MakeSite(2, 12);
  const StatusOr<MapperResult> a = BuildMap(site.inputs, std::nullopt, Associating());
  const StatusOr<MapperResult> b =
      BuildMap({site.inputs[1], site.inputs[0]}, std::nullopt, Associating());
  ASSERT_TRUE(a.ok() && b.ok());
  EXPECT_EQ(ContentHash(a->content), ContentHash(b->content));
}

Mode At(double x, double sd, int number = 0) {
  Mode mode;
  mode.number = ModeNumber(number);
  mode.p_map_landmark = {x, 0.0};
  mode.cov_p_map_landmark = Eigen::Matrix2d::Identity() * sd * sd;
  return mode;
}

TEST(AddAnonymousLandmarks, ClosestPairsAreOne) {
  std::vector<Mode> landmarks = {At(0.0, 0.2, 3), At(5.0, 0.2, 8)};
  AddAnonymousLandmarks({At(0.4, 0.1), At(0.1, 0.3), At(7.0, 0.1)}, {}, &landmarks);
  ASSERT_EQ(landmarks.size(), 4U);
  // Both are within the gate of the first; the one that is nearer in its own uncertainty has it,
  // and is worse known.
  EXPECT_EQ(landmarks[0].number, ModeNumber(3));
  EXPECT_EQ(landmarks[0].p_map_landmark.x(), 0.0);
  EXPECT_EQ(landmarks[1].p_map_landmark.x(), 5.0);
  EXPECT_EQ(landmarks[2].p_map_landmark.x(), 0.4);
  EXPECT_EQ(landmarks[2].number, ModeNumber(9));
  EXPECT_EQ(landmarks[3].number, ModeNumber(10));
}

TEST(AddAnonymousLandmarks, TheBetterKnownPositionStays) {
  std::vector<Mode> landmarks = {At(0.0, 0.5, 1)};
  AddAnonymousLandmarks({At(0.3, 0.1)}, {}, &landmarks);
  ASSERT_EQ(landmarks.size(), 1U);
  EXPECT_EQ(landmarks[0].number, ModeNumber(1));
  EXPECT_EQ(landmarks[0].p_map_landmark.x(), 0.3);
}

}  // namespace
}  // namespace shiftmap
