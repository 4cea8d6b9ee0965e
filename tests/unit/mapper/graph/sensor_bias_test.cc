// SPDX-License-Identifier: Apache-2.0
#include "mapper/graph/sensor_bias.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

Observation RangeBearing(double range_m, double bearing_rad) {
  Observation observation;
  observation.z = {range_m, bearing_rad};
  return observation;
}

TEST(SensorBias, JacobianIsTheDerivative) {
  std::mt19937_64 random(testing::TestSeed(21));
  std::normal_distribution<double> normal;
  constexpr double kStep = 1e-6;
  for (int trial = 0; trial < 50; ++trial) {
    const Se2 T_map_vehicle(normal(random), normal(random), normal(random));
    const Eigen::Vector2d p_map_landmark(5.0 + normal(random), normal(random));
    const Observation observation = RangeBearing(4.0 + std::abs(normal(random)), normal(random));
    const SensorBias bias(0.02 * normal(random), 0.05 * normal(random), 0.5 * normal(random));
    Eigen::Matrix<double, 2, 3> J_bias;
    LinearizeBiased(observation, T_map_vehicle, p_map_landmark, bias, 0.2, &J_bias);
    for (int column = 0; column < 3; ++column) {
      const SensorBias step = kStep * SensorBias::Unit(column);
      const auto nu = [&](const SensorBias& at) {
        return LinearizeBiased(observation, T_map_vehicle, p_map_landmark, at, 0.2).nu;
      };
      // ν = z - h, so dh/d bias is its negative derivative.
      const Eigen::Vector2d numeric = (nu(bias - step) - nu(bias + step)) / (2.0 * kStep);
      EXPECT_THAT(J_bias.col(column), testing::IsNearMatrix(numeric, 1e-7)) << trial;
    }
  }
}

TEST(SensorBias, ExplainsWhatABiasedSensorReads) {
  const Eigen::Vector2d p_map_landmark(4.0, 3.0);
  const SensorBias bias(0.03, 0.04, -0.4);
  const double mean_squared_bearing = 0.1;
  const double range = 5.0;
  const double bearing = std::atan2(3.0, 4.0);
  // The curvature is evaluated at the bearing that was read.
  const double read = bearing + bias[kBearingOffset];
  const Observation observation =
      RangeBearing(std::exp(bias[kLogRangeScale]) * range *
                       (1.0 + bias[kRangeCurvature] * (read * read - mean_squared_bearing)),
                   read);
  const Innovation innovation =
      LinearizeBiased(observation, Se2(), p_map_landmark, bias, mean_squared_bearing);
  EXPECT_THAT(innovation.nu, testing::IsNearMatrix(Eigen::Vector2d::Zero(), 1e-12));
  EXPECT_THAT(Unbiased(observation, bias, mean_squared_bearing).z,
              testing::IsNearMatrix(Eigen::Vector2d(range, bearing), 1e-12));
}

TEST(SensorBias, CartesianObservationsHaveTheScaleAlone) {
  Observation observation;
  observation.kind = Observation::Kind::kCartesian;
  observation.z = {3.0, 1.0};
  const Eigen::Vector2d p_map_landmark(3.2, 0.9);
  Eigen::Matrix<double, 2, 3> J_bias;
  const SensorBias bias(0.02, 0.1, 0.5);
  const Innovation biased = LinearizeBiased(observation, Se2(), p_map_landmark, bias, 0.2, &J_bias);
  const Eigen::Vector2d read = std::exp(0.02) * p_map_landmark;
  EXPECT_THAT(biased.nu, testing::IsNearMatrix(observation.z - read, 1e-12));
  observation.z = read;
  EXPECT_THAT(Unbiased(observation, bias, 0.2).z, testing::IsNearMatrix(p_map_landmark, 1e-12));
  EXPECT_THAT(J_bias.col(kLogRangeScale), testing::IsNearMatrix(read, 1e-12));
  EXPECT_TRUE(J_bias.rightCols<2>().isZero());
}

}  // namespace
}  // namespace shiftmap
