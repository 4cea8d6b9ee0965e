// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/distortion_calibration.h"

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <random>
#include <vector>

#include "mapper/run_maps/run_map.h"
#include "mapper/run_maps/single_run.h"
#include "mapstore/geometry/inner_constraints.h"
#include "mapstore/run/trajectory.h"
#include "tests/support/geometry_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

constexpr std::uint64_t kWorlds = 4;

// What the test's sensor reads too much, of about half of its noise.
Eigen::Vector2d ErrorAt(double bearing) {
  return {0.08 - 0.05 * bearing, 0.01 - 0.03 * bearing * bearing};
}

SimulatedWorld DistortedWorld(std::uint64_t seed, bool cartesian) {
  OpenWorldOptions options = testing::SmallWorld(seed);
  options.runs = 1;
  options.modes_per_group = 1;
  options.duration_s = 2000.0;
  SimulatedWorld world = testing::Simulate(options);
  for (SimulatedRun& simulated : world.runs) {
    for (Scan& scan : simulated.run.scans) {
      for (Observation& observation : scan.observations) {
        observation.z += ErrorAt(observation.z.y());
        if (!cartesian) continue;
        observation.z = observation.PositionInVehicle();
        observation.kind = Observation::Kind::kCartesian;
      }
    }
  }
  return world;
}

// NEES and squared errors of shapes: no run tells the scale.
testing::MapConsistency MapsOf(bool cartesian, double share) {
  MapperOptions options;
  options.distortion_share = share;
  testing::MapConsistency maps;
  for (std::uint64_t seed = 1; seed <= kWorlds; ++seed) {
    const SimulatedWorld world = DistortedWorld(seed, cartesian);
    const auto built = BuildMap(testing::Inputs(world), std::nullopt, options);
    EXPECT_TRUE(built.ok());
    if (!built.ok()) continue;
    testing::MapConsistency of_world = testing::MeasureConsistency(built->content, world);
    const testing::ModeErrors errors = testing::ErrorsOf(built->content, world);
    const Eigen::VectorXd grown = OffsetsFromCentroid(errors.positions).normalized();
    of_world.squared_error -= std::pow(grown.dot(errors.errors), 2);
    maps.Add(of_world);
  }
  return maps;
}

TEST(SensorDistortion, IsTakenOffPolarAndCartesianObservationsAlike) {
  std::mt19937_64 random(1);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  SensorDistortion distortion;
  for (double& value : distortion.coefficients.reshaped()) value = 1e-4 * uniform(random);
  for (int trial = 0; trial < 100; ++trial) {
    Observation polar;
    polar.z = {5.0 + 4.0 * uniform(random), 3.0 * uniform(random)};
    Observation cartesian = polar;
    cartesian.kind = Observation::Kind::kCartesian;
    cartesian.z = polar.PositionInVehicle();
    EXPECT_THAT(distortion.Undistorted(cartesian).z,
                testing::IsNearMatrix(distortion.Undistorted(polar).PositionInVehicle(), 1e-3));
    EXPECT_NE(distortion.Undistorted(polar).z, polar.z);
    EXPECT_EQ(SensorDistortion().Undistorted(polar).z, polar.z);
  }
}

// A polynomial says nothing far from the observations that it is of.
TEST(SensorDistortion, TakesOffHalfOfTheRangeAtMost) {
  SensorDistortion distortion;
  distortion.coefficients.col(0).setConstant(100.0);
  Observation seen;
  seen.z = {4.0, 0.1};
  EXPECT_EQ(distortion.Undistorted(seen).z, Eigen::Vector2d(2.0, -0.4));
}

TEST(SolveWithDistortions, MapsOfDistortedSensorsAreBetterAndKnowTheirErrors) {
  for (const bool cartesian : {false, true}) {
    const testing::MapConsistency with = MapsOf(cartesian, MapperOptions().distortion_share);
    const testing::MapConsistency without = MapsOf(cartesian, 0.0);
    EXPECT_LT(with.squared_error, 0.5 * without.squared_error) << cartesian;
    EXPECT_LT(with.PerLandmark(), 0.5 * without.PerLandmark()) << cartesian;
    EXPECT_LT(with.PerLandmark(), 3.0) << cartesian;
  }
}

// The consistency of a run map's shape with the truth.
testing::MapConsistency ShapeConsistencyOf(const RunMap& run_map, const SimulatedWorld& world) {
  std::vector<PointPair> pairs;
  std::vector<Eigen::Vector2d> positions;
  for (const AlignmentPoint& point : run_map.points) {
    const auto group = static_cast<std::size_t>(point.group.value());
    pairs.push_back({point.position, world.groups[group].modes.front()});
    positions.push_back(point.position);
  }
  const Se2 T_map_world = AlignRigid2d(pairs).value();
  Eigen::VectorXd errors(2 * std::ssize(pairs));
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    errors.segment<2>(static_cast<Eigen::Index>(2 * i)) = pairs[i].p_a - T_map_world * pairs[i].p_b;
  }
  // A run observes neither the pose nor the scale of the whole.
  Eigen::MatrixXd unknown(errors.size(), 4);
  unknown << GaugeDirections(positions), OffsetsFromCentroid(positions).normalized();
  errors -= unknown * (unknown.transpose() * errors);
  return testing::ConsistencyOf(errors, run_map.covariance, unknown);
}

TEST(MakeUndistortedRunMap, IsBetterAndKnowsItsErrors) {
  const MapperOptions options;
  testing::MapConsistency with;
  testing::MapConsistency without;
  for (std::uint64_t seed = 1; seed <= kWorlds; ++seed) {
    const SimulatedWorld world = DistortedWorld(seed, false);
    const MappingRun run = testing::Arrange(world, world.runs.front().run);
    const BuildState build = MapSingleRun(run, world.groups.size(), options);
    without.Add(ShapeConsistencyOf(MakeRunMap(options, build).value(), world));
    with.Add(ShapeConsistencyOf(MakeUndistortedRunMap(options, build).value(), world));
  }
  EXPECT_LT(with.squared_error, 0.5 * without.squared_error);
  EXPECT_LT(with.PerLandmark(), 0.5 * without.PerLandmark());
  EXPECT_LT(with.PerLandmark(), 3.0);
}

TEST(SolveWithDistortions, AreNoneWithoutCalibration) {
  const SimulatedWorld world = DistortedWorld(1, false);
  MapperOptions options;
  options.calibrate = false;
  const auto held = BuildMap(testing::Inputs(world), std::nullopt, options);
  options.distortion_share = 0.0;
  const auto without = BuildMap(testing::Inputs(world), std::nullopt, options);
  ASSERT_TRUE(held.ok() && without.ok());
  EXPECT_EQ(held->content.covariance.Dense(), without->content.covariance.Dense());
}

}  // namespace
}  // namespace shiftmap
