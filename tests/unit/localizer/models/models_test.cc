// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>

#include "localizer/models/motion_model.h"
#include "localizer/models/observation_model.h"
#include "mapstore/geometry/angle.h"
#include "tests/support/geometry_matchers.h"

namespace shiftmap {
namespace {

constexpr double kStep = 1e-6;

Eigen::Vector2d Difference(Observation::Kind kind, Eigen::Vector2d a, const Eigen::Vector2d& b) {
  a -= b;
  if (kind == Observation::Kind::kRangeBearing) a.y() = WrapAngle(a.y());
  return a;
}

TEST(ObservationModel, JacobiansAgreeWithDifferences) {
  const Se2 T_map_vehicle(1.0, -2.0, 2.5);
  const Eigen::Vector2d p(-3.0, 0.7);
  for (const auto kind : {Observation::Kind::kRangeBearing, Observation::Kind::kCartesian}) {
    Observation observation;
    observation.kind = kind;
    observation.z = {4.0, 0.3};
    const Innovation at = Linearize(observation, T_map_vehicle, p);
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d xi = kStep * Eigen::Vector3d::Unit(i);
      const Innovation moved = Linearize(observation, T_map_vehicle * Se2::Exp(xi), p);
      const Eigen::Vector2d column = Difference(kind, at.nu, moved.nu) / kStep;
      EXPECT_LT((column - at.H_pose.col(i)).norm(), 1e-5);
    }
    for (int i = 0; i < 2; ++i) {
      const Innovation moved =
          Linearize(observation, T_map_vehicle, p + kStep * Eigen::Vector2d::Unit(i));
      const Eigen::Vector2d column = Difference(kind, at.nu, moved.nu) / kStep;
      EXPECT_LT((column - at.H_landmark.col(i)).norm(), 1e-5);
    }
  }
}

TEST(ObservationModel, APerfectObservationHasNoInnovation) {
  const Se2 T_map_vehicle(3.0, 4.0, -1.0);
  Observation observation;
  observation.z = {2.5, -0.4};
  const Eigen::Vector2d p = LandmarkPosition(observation, T_map_vehicle);
  EXPECT_LT(Linearize(observation, T_map_vehicle, p).nu.norm(), 1e-12);
}

TEST(ObservationModel, CorrectionTakesOffWhatTheSensorAdds) {
  SensorCalibration sensor;
  sensor.range_curvature_per_rad2 = -0.5;
  sensor.mean_squared_bearing_rad2 = 0.1;
  sensor.bearing_offset_rad = 0.04;
  for (const double bearing : {-0.7, 0.0, 0.6}) {
    Observation seen;
    seen.z.y() = bearing + sensor.bearing_offset_rad;
    seen.z.x() = 5.0 * (1.0 - 0.5 * (seen.z.y() * seen.z.y() - 0.1));
    const Observation corrected = Corrected(seen, sensor);
    EXPECT_NEAR(corrected.z.x(), 5.0, 1e-12);
    EXPECT_NEAR(corrected.z.y(), bearing, 1e-12);
  }
  Observation seen;
  seen.z = {5.0, -3.12};
  EXPECT_NEAR(Corrected(seen, sensor).z.y(), WrapAngle(-3.16), 1e-12);
  seen.kind = Observation::Kind::kCartesian;
  EXPECT_EQ(Corrected(seen, sensor).z, seen.z);
}

TEST(MotionModel, CalibrationJacobianAgreesWithDifferences) {
  std::vector<OdometrySample> odometry;
  for (int i = 0; i < 60; ++i) {
    odometry.push_back(
        {StampFromSeconds(10.0 + 0.1 * i), 0.4 + 0.1 * (i % 3), 0.2 - 0.05 * (i % 4)});
  }
  const Stamp begin = StampFromSeconds(11.03);
  const Stamp end = StampFromSeconds(14.07);
  const auto integrate = [&](const Eigen::Vector2d& log_scale) {
    OdometryCalibration calibration;
    calibration.scale_v = std::exp(log_scale.x());
    calibration.scale_omega = std::exp(log_scale.y());
    std::size_t hint = 0;
    return IntegrateMotion(odometry, begin, end, calibration, &hint);
  };
  const MotionIncrement at = integrate(Eigen::Vector2d::Zero());
  for (int i = 0; i < 2; ++i) {
    const MotionIncrement moved = integrate(kStep * Eigen::Vector2d::Unit(i));
    const Eigen::Vector3d column = (at.T_begin_end.Inverse() * moved.T_begin_end).Log() / kStep;
    EXPECT_LT((column - at.J_calibration.col(i)).norm(), 1e-5);
  }
}

// The sums of a whole stretch against the same, arc by arc, over standing, turns and a gap.
TEST(MotionModel, IntegratingIsAppendingArcByArc) {
  std::vector<OdometrySample> odometry;
  double seconds = 5.0;
  for (int i = 0; i < 400; ++i) {
    const bool stands = i % 50 > 40;
    odometry.push_back({StampFromSeconds(seconds),
                        stands ? 0.0 : 1.5 - 0.02 * (i % 90),
                        stands ? 0.0 : 0.9 * std::sin(0.05 * i) - 0.004 * (i % 100)});
    seconds += i == 200 ? 0.9 : 0.04;
  }
  OdometryCalibration calibration;
  calibration.scale_v = 1.07;
  calibration.scale_omega = 0.94;
  calibration.noise_v = 0.03;
  calibration.noise_omega = 0.05;
  calibration.lag_s = 0.0;

  MotionIncrement expected;
  for (std::size_t i = 0; i + 1 < odometry.size(); ++i) {
    AppendMotion(odometry[i].v_mps,
                 odometry[i].omega_radps,
                 odometry[i + 1].stamp - odometry[i].stamp,
                 calibration,
                 &expected);
  }
  std::size_t hint = 0;
  const MotionIncrement motion =
      IntegrateMotion(odometry, odometry.front().stamp, odometry.back().stamp, calibration, &hint);
  EXPECT_THAT(motion.T_begin_end, testing::IsNearPose(expected.T_begin_end, 1e-12));
  EXPECT_TRUE(motion.cov.isApprox(expected.cov, 1e-11));
  EXPECT_TRUE(
      motion.J_calibration.leftCols<2>().isApprox(expected.J_calibration.leftCols<2>(), 1e-11));
  EXPECT_EQ(hint, odometry.size() - 1);
}

// A parked vehicle, or a clock that jumps while it drives.
TEST(MotionModel, WhereALogIsSilentTheVehicleStands) {
  constexpr double kSpeed = 1.5;
  OdometryCalibration calibration;
  calibration.noise_v = 0.02;
  calibration.noise_omega = 0.01;
  for (const double silence_s : {10.0, 1e5, 3e8}) {
    const std::vector<OdometrySample> odometry = {{StampFromSeconds(100.0), kSpeed, 0.0},
                                                  {StampFromSeconds(100.0 + silence_s), 0.0, 0.0}};
    std::size_t hint = 0;
    const MotionIncrement motion =
        IntegrateMotion(odometry, odometry[0].stamp, odometry[1].stamp, calibration, &hint);
    EXPECT_NEAR(motion.T_begin_end.x(), kSpeed * kOdometryHold, 1e-9);
    // Noise of the way held, and of the silence that counts.
    const double seconds = kOdometryHold + std::min(silence_s - kOdometryHold, kMaxSilence);
    // Of what it may have done meanwhile, at the speed that it had.
    const double unknown = std::min(silence_s - kOdometryFresh, 10.0);
    EXPECT_NEAR(motion.cov(0, 0), 4e-4 * seconds + std::pow(kSpeed * unknown, 2), 1e-9);
    EXPECT_NEAR(motion.cov(2, 2), 1e-4 * seconds + 0.25 * unknown, 1e-9);
    // Before the first sample as well, of which it holds as long.
    hint = 0;
    const MotionIncrement before = IntegrateMotion(
        odometry, odometry[0].stamp - FromSeconds(50.0), odometry[0].stamp, calibration, &hint);
    EXPECT_NEAR(before.T_begin_end.x(), kSpeed * kOdometryHold, 1e-9);
    EXPECT_NEAR(before.cov(0, 0), 4e-4 * 50.0 + kSpeed * kSpeed * (10.0 * 48.5 - 25.0), 1e-9);
  }
}

// Before the first sample, in a gap, and after the last one.
TEST(MotionModel, PartsOfASilenceAddUpToAllOfIt) {
  OdometryCalibration calibration;
  const std::vector<OdometrySample> odometry = {{StampFromSeconds(100.0), 0.5, 0.1},
                                                {StampFromSeconds(106.0), 1.0, 0.1}};
  const auto integrate = [&](double begin_s, double end_s) {
    std::size_t hint = 0;
    return IntegrateOdometry(
        odometry, StampFromSeconds(begin_s), StampFromSeconds(end_s), calibration, &hint);
  };
  const IntegratedMotion gap = integrate(100.0, 106.0);
  EXPECT_NEAR(gap.unknown_way, 4.5 * 4.5, 1e-9);  // At the faster of both speeds, 1 m/s.
  EXPECT_NEAR(gap.unknown_turn, 0.25 * 4.5, 1e-9);
  for (const auto& [begin_s, end_s] :
       {std::pair(60.0, 100.0), std::pair(100.0, 106.0), std::pair(106.0, 146.0)}) {
    const IntegratedMotion whole = integrate(begin_s, end_s);
    double way = 0.0;
    double turn = 0.0;
    for (double part_s = begin_s; part_s < end_s; part_s += 0.5) {
      const IntegratedMotion motion = integrate(part_s, part_s + 0.5);
      const bool fresh = (part_s >= 98.5 && part_s < 101.5) || (part_s >= 106.0 && part_s < 107.5);
      EXPECT_EQ(motion.Measured(), fresh) << part_s;
      way += motion.unknown_way;
      turn += motion.unknown_turn;
    }
    EXPECT_NEAR(way, whole.unknown_way, 1e-9) << begin_s;
    EXPECT_NEAR(turn, whole.unknown_turn, 1e-9) << begin_s;
  }
}

TEST(MotionModel, AVehicleThatStandsBeforeAndAfterASilenceStoodMeanwhile) {
  const std::vector<OdometrySample> odometry = {{StampFromSeconds(100.0), 0.0, 0.0},
                                                {StampFromSeconds(160.0), 0.0, 0.0}};
  std::size_t hint = 0;
  EXPECT_TRUE(
      IntegrateOdometry(odometry, odometry[0].stamp, odometry[1].stamp, {}, &hint).Measured());
}

}  // namespace
}  // namespace shiftmap
