// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/moving_visits.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>

#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

using ::testing::IsEmpty;
using ::testing::Pair;
using ::testing::UnorderedElementsAre;

Observation At(const char* signature, const Eigen::Vector2d& p_vehicle) {
  Observation observation;
  observation.signature = Signature(signature);
  observation.z = {p_vehicle.norm(), std::atan2(p_vehicle.y(), p_vehicle.x())};
  return observation;
}

TEST(MovingVisits, ACodeOnTheVehicleMoves) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    shiftmap::Run run = testing::StaticWorld(seed).runs[0].run;
    for (Scan& scan : run.scans) scan.observations.push_back(At("own", {1.0, 0.3}));
    EXPECT_THAT(MovingSightings(run, {}),
                UnorderedElementsAre(Pair(Signature("own"), static_cast<int>(run.scans.size()))))
        << seed;
  }
}

// The map and its trajectory are as if the code were not there.
TEST(MovingVisits, ACodeOnTheVehicleChangesNoMap) {
  const SimulatedWorld world = testing::Simulate(testing::SmallWorld(1));
  SimulatedWorld with = world;
  for (SimulatedRun& simulated : with.runs) {
    for (Scan& scan : simulated.run.scans) {
      if (scan.observations.empty()) continue;  // No key frame by itself.
      scan.observations.push_back(At("own", {1.0, 0.3}));
    }
  }
  const auto expected = BuildMap(testing::Inputs(world), std::nullopt, {});
  const auto result = BuildMap(testing::Inputs(with), std::nullopt, {});
  ASSERT_TRUE(expected.ok() && result.ok());
  EXPECT_EQ(testing::ErrorsOf(result->content, world).errors,
            testing::ErrorsOf(expected->content, world).errors);
}

// Of a vehicle that drives ahead of this one for a while, again and again.
TEST(MovingVisits, ACodeOnAnotherVehicleMoves) {
  SimulatedRun simulated = testing::StaticWorld(1).runs[0];
  const Stamp begin = simulated.truth.front().stamp;
  int seen = 0;
  for (Scan& scan : simulated.run.scans) {
    const double t = std::fmod(ToSeconds(scan.stamp - begin), 50.0);
    if (t > 30.0) continue;
    scan.observations.push_back(At("other", {4.0 + 0.1 * t, 2.0 * std::sin(0.2 * t)}));
    ++seen;
  }
  EXPECT_THAT(MovingSightings(simulated.run, {}),
              UnorderedElementsAre(Pair(Signature("other"), ::testing::Gt(seen / 2))));
}

TEST(MovingVisits, LandmarksStandWhateverTheOdometryDoes) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedRun right = testing::StaticWorld(seed).runs[0];
    const Stamp begin = right.truth.front().stamp;
    for (const auto& [speed, turn] : {std::pair(1.0, 1.0),
                                      std::pair(3.6, 1.0),
                                      std::pair(-1.0, 1.0),
                                      std::pair(1.0, -1.0),
                                      std::pair(0.0, 0.0),
                                      std::pair(1.0, 2.0)}) {
      shiftmap::Run run = right.run;
      for (OdometrySample& sample : run.odometry) {
        sample.v_mps *= speed;
        sample.omega_radps *= turn;
      }
      EXPECT_THAT(MovingSightings(run, {}), IsEmpty()) << seed << ' ' << speed << ' ' << turn;
    }
    shiftmap::Run slipping = right.run;
    for (OdometrySample& sample : slipping.odometry) {
      if (std::fmod(ToSeconds(sample.stamp - begin), 40.0) < 15.0) sample.v_mps = 4.0;
    }
    EXPECT_THAT(MovingSightings(slipping, {}), IsEmpty()) << seed;
    const SimulatedRun carried = testing::CarriedMeanwhile(
        right, begin + std::chrono::seconds(80), begin + std::chrono::seconds(120));
    EXPECT_THAT(MovingSightings(carried.run, {}), IsEmpty()) << seed;
  }
}

}  // namespace
}  // namespace shiftmap
