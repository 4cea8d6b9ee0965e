// SPDX-License-Identifier: Apache-2.0
#include "mapstore/run/run.h"

#include <gtest/gtest.h>

#include <limits>
#include <numbers>
#include <random>

#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap::testing {
namespace {

Stamp At(double seconds) { return StampFromSeconds(seconds); }

Observation RangeBearing(double range_m, double bearing_rad) {
  Observation observation;
  observation.signature = Signature("18");
  observation.z = {range_m, bearing_rad};
  return observation;
}

TEST(ObservationTest, PositionInVehicle) {
  const Eigen::Vector2d p = RangeBearing(2.0, std::numbers::pi / 2.0).PositionInVehicle();
  EXPECT_NEAR(p.x(), 0.0, 1e-15);
  EXPECT_NEAR(p.y(), 2.0, 1e-15);
  Observation cartesian = RangeBearing(-1.0, 7.0);
  cartesian.kind = Observation::Kind::kCartesian;
  EXPECT_EQ(cartesian.PositionInVehicle(), Eigen::Vector2d(-1.0, 7.0));
}

TEST(ValidateRunTest, NamesTheFirstWrongItem) {
  constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
  shiftmap::Run run;
  EXPECT_THAT(ValidateRun(run), StatusIs(StatusCode::kInvalidArgument, "no odometry"));
  run.odometry = {{At(1.0), 1.0, 0.1}, {At(1.0), 1.0, 0.1}, {At(2.0), 1.0, 0.1}};
  run.scans = {{At(1.0), {RangeBearing(3.0, 0.1)}}, {At(2.0), {}}};
  EXPECT_THAT(ValidateRun(run), IsOk());

  shiftmap::Run wrong = run;
  wrong.odometry[1].omega_radps = kNan;
  EXPECT_THAT(ValidateRun(wrong), StatusIs(StatusCode::kInvalidArgument, "1.000000 s"));
  wrong = run;
  wrong.odometry[2].stamp = At(0.5);
  EXPECT_THAT(ValidateRun(wrong), StatusIs(StatusCode::kInvalidArgument, "odometry goes back"));
  wrong = run;
  wrong.scans[1].stamp = At(0.5);
  EXPECT_THAT(ValidateRun(wrong), StatusIs(StatusCode::kInvalidArgument, "scans goes back"));
  wrong = run;
  wrong.scans[0].observations[0].z.x() = 0.0;
  EXPECT_THAT(ValidateRun(wrong), StatusIs(StatusCode::kInvalidArgument, "positive range"));
  wrong.scans[0].observations[0].kind = Observation::Kind::kCartesian;
  EXPECT_THAT(ValidateRun(wrong), IsOk());
  wrong.scans[0].observations[0].cov_z = -Eigen::Matrix2d::Identity();
  EXPECT_THAT(ValidateRun(wrong), StatusIs(StatusCode::kInvalidArgument, "positive definite"));
}

// Finite, but too large to be squared and summed, or so far off that times have no difference.
TEST(ValidateEventTest, RefusesWhatWouldOverflow) {
  const auto refused = [](const RunEvent& event, const std::string& message) {
    EXPECT_THAT(ValidateEvent(event), StatusIs(StatusCode::kInvalidArgument, message));
  };
  EXPECT_THAT(ValidateEvent(OdometrySample{At(1.0), 1e9, -1e9}), IsOk());
  refused(OdometrySample{At(1.0), 1e10, 0.0}, "v = 1");
  refused(OdometrySample{At(1.0), 0.0, -1e200}, "omega = -1e+200");
  EXPECT_THAT(ValidateEvent(OdometrySample{At(-1.0), 0.0, 0.0}), IsOk());
  refused(OdometrySample{Stamp::min(), 0.0, 0.0}, "stamp_ns");
  refused(Scan{Stamp::max(), {}}, "stamp_ns");
  Observation observation = RangeBearing(1e9, -1e9);
  observation.cov_z = 1e18 * Eigen::Matrix2d::Identity();
  EXPECT_THAT(ValidateEvent(Scan{At(1.0), {observation}}), IsOk());
  observation.cov_z = 1e20 * Eigen::Matrix2d::Identity();
  refused(Scan{At(1.0), {observation}}, "variance");
  refused(Scan{At(1.0), {RangeBearing(1e10, 0.0)}}, "z = (1");
  refused(Scan{At(1.0), {RangeBearing(1.0, 1e100)}}, "1e+100");
}

TEST(ValidateEventTest, RefusesWhatNoLidarMeasures) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  const auto refused = [](const LidarScan& scan, const std::string& message) {
    EXPECT_THAT(ValidateEvent(scan), StatusIs(StatusCode::kInvalidArgument, message));
  };
  const LidarScan good{At(1.0), {}, {0.0f, 80.0f, 10'000.0f}};
  EXPECT_THAT(ValidateEvent(good), IsOk());
  for (const float range : {kNan, -0.001f, 10'000.1f, std::numeric_limits<float>::infinity()}) {
    LidarScan scan = good;
    scan.ranges_m[1] = range;
    refused(scan, "lidar scan at 1.000000 s: beam 1: range ");
  }
  LidarScan scan = good;
  scan.ranges_m.resize(1);
  refused(scan, "1 beams, expected 2 to 10000");
  scan.ranges_m.resize(10'001);
  refused(scan, "10001 beams");
  scan = good;
  scan.sensor.field_of_view_rad = 6.3;
  refused(scan, "field_of_view_rad 6.3");
  scan = good;
  scan.sensor.max_range_m = std::numeric_limits<double>::quiet_NaN();
  refused(scan, "max_range_m nan");
  scan = good;
  scan.sensor.T_vehicle_lidar = Se2(1e10, 0.0, 0.0);
  refused(scan, "lidar at x 1");
  scan.sensor.T_vehicle_lidar = Se2(0.0, 0.0, std::numeric_limits<double>::quiet_NaN());
  refused(scan, "yaw nan");
  scan = good;
  scan.stamp = Stamp::max();
  refused(scan, "stamp_ns");
  shiftmap::Run run;
  run.odometry = {{At(1.0), 0.0, 0.0}};
  run.lidar_scans = {good, good};
  EXPECT_THAT(ValidateRun(run), IsOk());
  run.lidar_scans[1].stamp = At(0.5);
  EXPECT_THAT(ValidateRun(run), StatusIs(StatusCode::kInvalidArgument, "lidar scans goes back"));
}

TEST(MergeEventsTest, KeepsEverythingInOrderOfTimeOdometryFirst) {
  std::mt19937_64 random(TestSeed(51));
  for (int round = 0; round < 20; ++round) {
    shiftmap::Run run;
    for (int t = 0; t < 30; ++t) {
      for (auto n = random() % 3; n > 0; --n) run.odometry.push_back({At(t), double(n), 0.0});
      for (auto n = random() % 3; n > 0; --n) run.scans.push_back({At(t), {}});
      for (auto n = random() % 3; n > 0; --n) run.lidar_scans.push_back({At(t), {}, {}});
    }
    const std::vector<RunEvent> events = MergeEvents(run);
    ASSERT_EQ(events.size(), run.odometry.size() + run.scans.size() + run.lidar_scans.size());
    for (std::size_t i = 1; i < events.size(); ++i) {
      EXPECT_LE(StampOf(events[i - 1]), StampOf(events[i]));
      if (StampOf(events[i - 1]) == StampOf(events[i])) {
        EXPECT_LE(events[i - 1].index(), events[i].index());
      }
    }
  }
}

}  // namespace
}  // namespace shiftmap::testing
