// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <numbers>
#include <random>

#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsNearPose;
using testing::IsOk;
using testing::StatusIs;

TEST(Tum, SurvivesARoundTrip) {
  std::mt19937_64 random(testing::TestSeed(1));
  std::uniform_real_distribution<double> number(-100.0, 100.0);
  std::vector<StampedPose> trajectory;
  for (int i = 0; i < 200; ++i) {
    trajectory.push_back({Stamp(std::chrono::microseconds(1'248'272'263'000'001 + 333'333 * i)),
                          Se2(number(random), number(random), number(random))});
  }
  const testing::TempDir dir;
  ASSERT_THAT(WriteTum(trajectory, dir.File("a.tum")), IsOk());
  const auto read = ReadTum(dir.File("a.tum"));
  ASSERT_THAT(read, IsOk());
  ASSERT_EQ(read->size(), trajectory.size());
  for (std::size_t i = 0; i < trajectory.size(); ++i) {
    EXPECT_EQ((*read)[i].stamp, trajectory[i].stamp);
    EXPECT_EQ((*read)[i].T_map_vehicle.x(), trajectory[i].T_map_vehicle.x());
    EXPECT_THAT((*read)[i].T_map_vehicle, IsNearPose(trajectory[i].T_map_vehicle, 1e-14));
  }
}

TEST(Tum, WritesTheFormatThatOthersRead) {
  const testing::TempDir dir;
  const std::vector<StampedPose> trajectory = {
      {StampFromNanoseconds(1'500'000'000'000'001'400), Se2(1.5, -2.0, std::numbers::pi / 2.0)}};
  ASSERT_THAT(WriteTum(trajectory, dir.File("a.tum")), IsOk());
  EXPECT_THAT(testing::ReadFile(dir.File("a.tum")),
              ::testing::StartsWith("1500000000.000001 1.5 -2 0 0 0 0.7071067811865"));
}

TEST(Tum, SkipsCommentsAndEmptyLines) {
  const testing::TempDir dir;
  testing::WriteFile(dir.File("a.tum"), "# t x y z\n\n  \r\n1 2 3 0 0 0 0 1\r\n");
  const auto read = ReadTum(dir.File("a.tum"));
  ASSERT_THAT(read, IsOk());
  ASSERT_EQ(read->size(), 1U);
  EXPECT_EQ(read->front().stamp, StampFromSeconds(1.0));
}

TEST(Tum, NamesTheLineThatIsWrong) {
  const char* wrong[] = {"1 2 3 0 0 0 0",          // Too few.
                         "1 2 3 0 0 0 0 1 9",      // Too many.
                         "1 2 x 0 0 0 0 1",        // No number.
                         "1 2 nan 0 0 0 0 1",      // Not finite.
                         "1 2 3 0.5 0 0 0 1",      // Above the plane.
                         "1 2 3 0 0.5 0 0 0.866",  // Rolled.
                         "1 2 3 0 0 0 0 0.5",      // No unit quaternion.
                         "0.5 2 3 0 0 0 0 1",      // Backwards.
                         "1e300 2 3 0 0 0 0 1",    // No stamp.
                         "5e9 2 3 0 0 0 0 1"};     // Too far to count the time until then.
  for (const char* line : wrong) {
    const testing::TempDir dir;
    testing::WriteFile(dir.File("a.tum"), std::string("1 0 0 0 0 0 0 1\n") + line + "\n");
    EXPECT_THAT(ReadTum(dir.File("a.tum")), StatusIs(StatusCode::kInvalidArgument, "a.tum:2"))
        << line;
  }
  EXPECT_THAT(ReadTum("/nonexistent.tum"), StatusIs(StatusCode::kNotFound, "nonexistent"));
}

TEST(Interpolate, FollowsTheArcOfConstantTwist) {
  const Eigen::Vector3d twist(2.0, 0.1, 1.2);
  const Se2 start(3.0, -1.0, 3.0);
  const std::vector<StampedPose> trajectory = {{StampFromSeconds(10.0), start},
                                               {StampFromSeconds(12.0), start * Se2::Exp(twist)}};
  for (const double share : {0.0, 0.25, 0.5, 0.75, 1.0}) {
    const auto pose =
        Interpolate(trajectory, StampFromSeconds(10.0 + 2.0 * share), FromSeconds(2.0));
    ASSERT_TRUE(pose.has_value());
    EXPECT_THAT(*pose, IsNearPose(start * Se2::Exp(share * twist), 1e-12));
  }
}

TEST(Interpolate, ReturnsNothingInGapsAndBeyondTheEnds) {
  const std::vector<StampedPose> trajectory = {{StampFromSeconds(1.0), Se2()},
                                               {StampFromSeconds(5.0), Se2()}};
  const Duration gap = FromSeconds(3.0);
  EXPECT_FALSE(Interpolate(trajectory, StampFromSeconds(0.5), gap).has_value());
  EXPECT_FALSE(Interpolate(trajectory, StampFromSeconds(5.5), gap).has_value());
  EXPECT_FALSE(Interpolate(trajectory, StampFromSeconds(3.0), gap).has_value());
  EXPECT_TRUE(Interpolate(trajectory, StampFromSeconds(5.0), gap).has_value());
  EXPECT_FALSE(Interpolate({}, StampFromSeconds(3.0), gap).has_value());
}

std::vector<PointPair> RandomPairs(const Se2& T_a_b,
                                   int count,
                                   double sd,
                                   std::mt19937_64* random) {
  std::uniform_real_distribution<double> coordinate(-50.0, 50.0);
  std::normal_distribution<double> noise;
  std::vector<PointPair> pairs;
  for (int i = 0; i < count; ++i) {
    const double x = coordinate(*random);
    const Eigen::Vector2d p_b(x, coordinate(*random));
    const double dx = sd * noise(*random);
    pairs.push_back({T_a_b * p_b + Eigen::Vector2d(dx, sd * noise(*random)), p_b});
  }
  return pairs;
}

TEST(AlignRigid2d, RecoversATransform) {
  std::mt19937_64 random(testing::TestSeed(2));
  std::uniform_real_distribution<double> number(-100.0, 100.0);
  for (int trial = 0; trial < 100; ++trial) {
    const Se2 T_a_b(number(random), number(random), number(random));
    const auto aligned = AlignRigid2d(RandomPairs(T_a_b, 2 + trial % 5, 0.0, &random));
    ASSERT_THAT(aligned, IsOk());
    EXPECT_THAT(*aligned, IsNearPose(T_a_b, 1e-9));
  }
}

TEST(AlignRigid2d, NoTransformNearbyIsBetter) {
  std::mt19937_64 random(testing::TestSeed(3));
  const auto cost = [](const Se2& T_a_b, const std::vector<PointPair>& pairs) {
    double sum = 0.0;
    for (const PointPair& pair : pairs) sum += (pair.p_a - T_a_b * pair.p_b).squaredNorm();
    return sum;
  };
  const std::vector<PointPair> pairs = RandomPairs(Se2(5.0, 6.0, 2.0), 20, 3.0, &random);
  const auto aligned = AlignRigid2d(pairs);
  ASSERT_THAT(aligned, IsOk());
  for (int axis = 0; axis < 3; ++axis) {
    for (const double step : {-1e-3, 1e-3}) {
      const Se2 moved = *aligned * Se2::Exp(step * Eigen::Vector3d::Unit(axis));
      EXPECT_GT(cost(moved, pairs), cost(*aligned, pairs));
    }
  }
}

TEST(AlignRigid2d, RefusesWhatHasNoRotation) {
  EXPECT_THAT(AlignRigid2d({}), StatusIs(StatusCode::kInvalidArgument, "0 pairs"));
  const std::vector<PointPair> same = {{{1.0, 2.0}, {3.0, 4.0}}, {{1.0, 2.0}, {5.0, 6.0}}};
  EXPECT_THAT(AlignRigid2d(same), StatusIs(StatusCode::kInvalidArgument, "coincide"));
}

}  // namespace
}  // namespace shiftmap
