// SPDX-License-Identifier: Apache-2.0
#include "tools/lidar/lidar_observations.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

#include "tests/support/ray_caster.h"

namespace shiftmap {
namespace {

// One corner, straight ahead of the lidar.
std::vector<double> CornerAhead(double range_m, const LidarSensor& sensor) {
  return CastScan(WallsAlong({{range_m - 2.0, -2.0}, {range_m, 0.0}, {range_m - 2.0, 2.0}}, false),
                  Se2(),
                  181,
                  sensor);
}

TEST(ObserveInterestPoints, GivesPlacesInTheVehicleFrameWithTheirNoise) {
  LidarFrontEndOptions options;
  options.sensor.T_vehicle_lidar = Se2(1.0, 0.5, 0.5 * std::numbers::pi);
  options.sd_range_m = 0.1;
  options.sd_bearing_rad = 0.02;
  options.sd_place_m = 0.05;
  const Stamp stamp = StampFromSeconds(12.0);
  const Scan scan = ObserveInterestPoints(stamp, CornerAhead(4.0, options.sensor), options);
  EXPECT_EQ(scan.stamp, stamp);
  ASSERT_EQ(scan.observations.size(), 1U);
  const Observation& seen = scan.observations.front();
  EXPECT_TRUE(seen.signature.anonymous());
  // The lidar looks to the left: ahead of it is the vehicle's y.
  EXPECT_LT((seen.PositionInVehicle() - Eigen::Vector2d(1.0, 4.5)).norm(), 1e-9);
  ASSERT_TRUE(seen.cov_z.has_value());
  EXPECT_NEAR((*seen.cov_z)(0, 0), std::pow(4.0 * 0.02, 2) + 0.0025, 1e-12);
  EXPECT_NEAR((*seen.cov_z)(1, 1), 0.01 + 0.0025, 1e-12);
  EXPECT_NEAR((*seen.cov_z)(0, 1), 0.0, 1e-12);
}

TEST(ObserveInterestPoints, LeavesOutWhatIsFar) {
  LidarFrontEndOptions options;
  options.max_point_range_m = 3.5;
  EXPECT_TRUE(
      ObserveInterestPoints({}, CornerAhead(4.0, options.sensor), options).observations.empty());
}

TEST(LidarFrontEndOptions, NamesWhatIsOutOfRange) {
  EXPECT_TRUE(LidarFrontEndOptions().Validate().ok());
  LidarFrontEndOptions options;
  options.sd_bearing_rad = 0.0;
  EXPECT_NE(Message(options.Validate()).find("sd_bearing_rad 0"), std::string::npos);
  options = {};
  options.max_point_range_m = -1.0;
  EXPECT_NE(Message(options.Validate()).find("max_point_range_m -1"), std::string::npos);
  options = {};
  options.points.scales = 0;
  EXPECT_FALSE(options.Validate().ok());
}

}  // namespace
}  // namespace shiftmap
