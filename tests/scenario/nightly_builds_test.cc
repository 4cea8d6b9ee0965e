// SPDX-License-Identifier: Apache-2.0
//
// Is a map that is built night after night, each on the version of the night before, as good as it
// says, and as good as one build of all runs?
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <optional>
#include <random>
#include <string>

#include "mapper/covariance/mode_covariance.h"
#include "mapper/mapper.h"
#include "mapstore/geometry/covariance.h"
#include "proto/core/check.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap::testing {
namespace {

constexpr int kNights = 8;

// Sites; more of them on demand.
int Seeds() {
  const char* asked = std::getenv("SHIFTMAP_NIGHTLY_SEEDS");
  return asked != nullptr ? std::atoi(asked) : 24;
}

// By how much the ranges of a fleet are too long, in standard deviations of a logarithm.
struct FleetScale {
  std::string name;
  double sd_common = 0.0;
  double sd_vehicle = 0.0;
};

// One run a night, of two vehicles in turn.
std::vector<MapperInput> Shifts(const SimulatedWorld& world,
                                const FleetScale& scale,
                                std::uint64_t seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal;
  const double common = scale.sd_common * normal(random);
  const double first = common + scale.sd_vehicle * normal(random);
  const double second = common + scale.sd_vehicle * normal(random);
  std::vector<MapperInput> inputs = Inputs(world);
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    for (Scan& scan : inputs[i].run.scans) {
      for (Observation& observation : scan.observations) {
        observation.z.x() *= std::exp(i % 2 == 0 ? first : second);
      }
    }
  }
  return inputs;
}

MapContent Build(std::vector<MapperInput> inputs, const std::optional<MapContent>& prior) {
  StatusOr<MapperResult> result = BuildMap(std::move(inputs), prior, MapperOptions());
  SHIFTMAP_CHECK(result.ok(), "{}", Message(result.status()));
  SHIFTMAP_CHECK(result->rejected.empty(), "{}", result->rejected.front().reason);
  return std::move(result->content);
}

class NightlyBuilds : public ::testing::TestWithParam<FleetScale> {};

TEST_P(NightlyBuilds, KnowHowGoodTheyAre) {
  std::vector<MapConsistency> nights(kNights);
  MapConsistency at_once;
  for (int seed = 1; seed <= Seeds(); ++seed) {
    OpenWorldOptions options = SmallWorld(static_cast<std::uint64_t>(seed));
    options.runs = kNights;
    const SimulatedWorld world = Simulate(options);
    const std::vector<MapperInput> shifts =
        Shifts(world, GetParam(), static_cast<std::uint64_t>(seed));
    std::optional<MapContent> map;
    for (std::size_t night = 0; night < kNights; ++night) {
      map = Build({shifts[night]}, map);
      nights[night].Add(MeasureConsistency(*map, world));
    }
    at_once.Add(MeasureConsistency(Build(shifts, std::nullopt), world));
  }
  for (const MapConsistency& night : nights) {
    std::printf("%.2f ", night.PerLandmark());
  }
  std::printf("at once %.2f; last night %.1f mm, at once %.1f mm RMS\n",
              at_once.PerLandmark(),
              1e3 * std::sqrt(nights.back().squared_error / nights.back().modes),
              1e3 * std::sqrt(at_once.squared_error / at_once.modes));

  // A site is one draw of its errors for all nights, most of which the next night inherits: the
  // nights of one fleet are right or wrong together.
  for (const MapConsistency& night : nights) ExpectRightVariances(night);
  ExpectRightVariances(at_once);
  if (GetParam().sd_vehicle > 0.0) return;
  // The scale of a map is no better than the sensor's, and the same for both.
  EXPECT_LT(nights.back().squared_error / nights.back().modes,
            1.5 * at_once.squared_error / at_once.modes);
}

// A site as runs of a shift see it, with more data than a few landmarks in a room.
OpenWorldOptions LargeSite(int landmarks, double size_m) {
  OpenWorldOptions options;
  options.seed = 3;
  options.groups = landmarks;
  options.modes_per_group = 1;
  options.size_m = size_m;
  options.duration_s = 500.0;
  options.odometry_rate_hz = 10.0;
  options.scan_rate_hz = 2.5;
  options.runs = 3;
  return options;
}

// The graph minimizes over the shape of a map; where its scale is free, all of its χ² is to be had
// for making it smaller. Runs whose ranges are longer change nothing about the map's units either.
TEST(NightlyBuildsOfALargeSite, LeaveTheScaleOfAMapAsItIs) {
  const SimulatedWorld world = Simulate(LargeSite(80, 40.0));
  std::vector<MapperInput> inputs = Inputs(world);
  for (Scan& scan : inputs[2].run.scans) {
    for (Observation& observation : scan.observations) observation.z.x() *= 1.01;
  }
  MapContent map = Build({inputs[0]}, std::nullopt);
  const double scale = ErrorsOf(map, world).Scale();
  EXPECT_LT(std::abs(scale), 1e-3);
  for (const std::size_t night : {1u, 2u}) {
    map = Build({inputs[night]}, map);
    EXPECT_NEAR(ErrorsOf(map, world).Scale(), scale, 5e-4) << "night " << night + 1;
  }
}

// Beyond kMaxJointModes a map is known in tiles.
TEST(NightlyBuildsOfALargeSite, ALargeMapBecomesBetterToo) {
  const SimulatedWorld world = Simulate(LargeSite(kMaxJointModes + 40, 70.0));
  const std::vector<MapperInput> inputs = Inputs(world);
  const MapContent first = Build({inputs[0], inputs[1]}, std::nullopt);
  ASSERT_GT(first.covariance.size(), kMaxJointModes);
  const MapContent second = Build({inputs[2]}, first);
  EXPECT_LE(second.covariance.size(), kMaxJointModes + 40);
  const MapConsistency before = MeasureConsistency(first, world);
  const MapConsistency after = MeasureConsistency(second, world);
  std::printf("%.1f mm, then %.1f mm RMS\n",
              1e3 * std::sqrt(before.squared_error / before.modes),
              1e3 * std::sqrt(after.squared_error / after.modes));
  EXPECT_LT(after.squared_error / after.modes, before.squared_error / before.modes);
  EXPECT_LT(after.nees, ChiSquareQuantile(0.9995, after.dof));
}

// A run by itself has one mode of a door, between its two places, though the map has both.
TEST(NightlyBuildsOfDoors, MakeNoPlaceTwice) {
  constexpr int kSites = 4;
  constexpr int kNightsOfDoors = 6;
  constexpr double kSurveySd = 0.02;
  MapConsistency consistency;
  std::ptrdiff_t twice = 0;
  for (int seed = 1; seed <= kSites; ++seed) {
    const SimulatedWorld world = Doors(static_cast<std::uint64_t>(seed), kNightsOfDoors);
    MapContent map = SurveyOf(world, kSurveySd);
    const std::ptrdiff_t places = map.covariance.size();
    for (const MapperInput& night : Inputs(world)) map = Build({night}, map);
    twice += map.covariance.size() - places;
    for (const MatchedMode& mode : MatchModes(map, world)) {
      EXPECT_LT(mode.error.norm(), 0.12) << "site " << seed << ", landmark " << mode.group;
    }
    consistency.Add(MeasureConsistency(map, world));
  }
  std::printf("%td places twice, %.2f\n", twice, consistency.PerLandmark());
  EXPECT_LE(twice, 2);
  EXPECT_LT(consistency.nees, ChiSquareQuantile(0.9995, consistency.dof));
}

INSTANTIATE_TEST_SUITE_P(Fleets,
                         NightlyBuilds,
                         ::testing::Values(FleetScale{"right_ranges"},
                                           FleetScale{"ranges_of_one_scale", 0.02},
                                           FleetScale{"ranges_of_two_scales", 0.0, 0.02}),
                         [](const auto& fleet) { return fleet.param.name; });

}  // namespace
}  // namespace shiftmap::testing
