// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/vehicle_update.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <random>

#include "mapstore/map/run_spread.h"
#include "tests/support/random_map.h"

namespace shiftmap {
namespace {

using Vector = SystematicErrors::Vector;

constexpr double kPriorSd = 0.05;
const Stamp kFirstNight = StampFromSeconds(1767600000.0);

// What runs with independent measurements of `values`, of standard deviation `sd`, make of the
// prior N(0, kPriorSd²).
VehicleEstimate Measured(const std::string& name, const Vector& values, double sd, Stamp stamp) {
  const double information = 1.0 / (sd * sd) + 1.0 / (kPriorSd * kPriorSd);
  VehicleEstimate estimate;
  estimate.vehicle = name;
  estimate.systematic.prior_sd.setConstant(kPriorSd);
  estimate.systematic.mean = values / (sd * sd * information);
  estimate.systematic.cov = SystematicErrors::Matrix::Identity() / information;
  VehicleCalibration& found = estimate.calibration;
  found.vehicle = name;
  found.runs = 1;
  found.stamp = stamp;
  return estimate;
}

// Two runs in a night, and each in a build of its own at the same time, which leaves no room for
// the random walk: the prior counts once either way.
TEST(UpdateVehicles, ThePriorCountsOnce) {
  const Vector first{0.01, -0.02, 0.03, 0.01, 0.02};
  const Vector second{0.03, -0.01, 0.01, 0.02, -0.01};
  std::vector<VehicleCalibration> one_by_one;
  UpdateVehicles({Measured("a", first, 0.02, kFirstNight)}, &one_by_one);
  UpdateVehicles({Measured("a", second, 0.02, kFirstNight)}, &one_by_one);
  VehicleEstimate both = Measured("a", 0.5 * (first + second), 0.02 / std::sqrt(2.0), kFirstNight);
  both.calibration.runs = 2;
  std::vector<VehicleCalibration> at_once;
  UpdateVehicles({both}, &at_once);
  ASSERT_EQ(one_by_one.size(), 1U);
  EXPECT_EQ(one_by_one[0].runs, 2);
  const auto expected = VehicleValues(at_once[0]);
  const auto values = VehicleValues(one_by_one[0]);
  for (std::size_t i = 0; i < kVehicleValues; ++i) EXPECT_NEAR(values[i], expected[i], 1e-12) << i;
  // Closed form: a normal mean with the run's own deviation as noise.
  const double variance = 0.02 * 0.02 + kRunSpread.log_scale * kRunSpread.log_scale;
  const double information = 2.0 / variance + 1.0 / (kPriorSd * kPriorSd);
  EXPECT_NEAR(at_once[0].log_scale_v.sd, std::sqrt(1.0 / information), 1e-12);
  EXPECT_NEAR(at_once[0].log_scale_v.value, 0.04 / variance / information, 1e-12);
}

// Nights of runs that differ from a vehicle that stays: the share of intervals that hold it.
TEST(UpdateVehicles, StaysHonestNightAfterNight) {
  constexpr int kVehicles = 400;
  constexpr int kNights = 20;
  std::mt19937_64 random(testing::TestSeed(17));
  std::normal_distribution<double> normal;
  int held = 0;
  double width = 0.0;
  for (int v = 0; v < kVehicles; ++v) {
    const double truth = kPriorSd * normal(random);
    std::vector<VehicleCalibration> known;
    for (int night = 0; night < kNights; ++night) {
      const double of_run = truth + kRunSpread.log_scale * normal(random);
      const Vector values{of_run + 0.01 * normal(random), 0.0, 0.0, 0.0, 0.0};
      UpdateVehicles({Measured("a", values, 0.01, kFirstNight + night * std::chrono::hours(24))},
                     &known);
    }
    const Interval interval = IntervalOf(known[0].log_scale_v);
    held += interval.low <= truth && truth <= interval.high ? 1 : 0;
    width += (interval.high - interval.low) / kVehicles;
  }
  // The walk that is allowed for does not take place: somewhat more than 95 %.
  EXPECT_GE(held, static_cast<int>(0.93 * kVehicles));
  EXPECT_LT(width, 2.0 * 1.96 * std::hypot(0.01, kRunSpread.log_scale) / std::sqrt(10.0));
}

TEST(UpdateVehicles, UnseenVehiclesStayBitForBit) {
  std::mt19937_64 random(testing::TestSeed(18));
  std::vector<VehicleCalibration> known = {testing::RandomVehicle(random, "b"),
                                           testing::RandomVehicle(random, "d")};
  const std::vector<VehicleCalibration> before = known;
  UpdateVehicles({Measured("a", Vector::Zero(), 0.02, kFirstNight),
                  Measured("c", Vector::Zero(), 0.02, kFirstNight),
                  Measured("", Vector::Zero(), 0.02, kFirstNight)},
                 &known);
  ASSERT_EQ(known.size(), 4U);
  EXPECT_EQ(known[0].vehicle, "a");
  EXPECT_EQ(known[2].vehicle, "c");
  for (const std::size_t i : {0U, 1U}) {
    EXPECT_EQ(VehicleValues(known[2 * i + 1]), VehicleValues(before[i]));
    EXPECT_EQ(known[2 * i + 1].stamp, before[i].stamp);
  }
}

TEST(UpdateVehicles, TimeMakesItLessSure) {
  const Vector first = Vector::Constant(0.01);
  const Vector second = Vector::Constant(0.02);
  double trust = 1.0;  // In the first night, less from gap to gap.
  for (const int days : {0, 30, 3000}) {
    std::vector<VehicleCalibration> known;
    UpdateVehicles({Measured("a", first, 0.005, kFirstNight)}, &known);
    UpdateVehicles({Measured("a", second, 0.005, kFirstNight + days * std::chrono::hours(24))},
                   &known);
    const double now = (0.02 - known[0].log_scale_v.value) / 0.01;
    EXPECT_LT(now, trust);
    trust = now;
  }
  EXPECT_LT(trust, 0.25);
}

TEST(UpdateVehicles, ARemountedSensorStartsAnew) {
  std::vector<VehicleCalibration> known;
  Vector values = Vector::Zero();
  UpdateVehicles({Measured("a", values, 0.002, kFirstNight)}, &known);
  values[3] = 0.15;
  const VehicleEstimate after = Measured("a", values, 0.002, kFirstNight + std::chrono::hours(24));
  UpdateVehicles({after}, &known);
  std::vector<VehicleCalibration> anew;
  UpdateVehicles({after}, &anew);
  EXPECT_EQ(known[0].runs, 1);
  EXPECT_EQ(VehicleValues(known[0]), VehicleValues(anew[0]));
}

TEST(UpdateVehicles, NoiseAndDetectionArePooled) {
  VehicleEstimate night = Measured("a", Vector::Zero(), 0.02, kFirstNight);
  night.calibration.range_m = {0.3, 100.0};
  night.calibration.bearing_rad = {0.02, 700.0};
  night.calibration.detection = {0.5, 200.0};
  std::vector<VehicleCalibration> known;
  UpdateVehicles({night}, &known);
  night.calibration.range_m = {0.1, 300.0};
  night.calibration.position_m = {0.2, 50.0};
  night.calibration.detection = {0.9, 600.0};
  UpdateVehicles({night}, &known);
  EXPECT_NEAR(known[0].range_m.sd, std::sqrt(0.25 * 0.09 + 0.75 * 0.01), 1e-12);
  EXPECT_NEAR(known[0].range_m.dof, 400.0, 1e-9);
  EXPECT_NEAR(known[0].bearing_rad.dof, 800.0, 1e-9);
  EXPECT_EQ(known[0].position_m.sd, 0.2);
  EXPECT_NEAR(known[0].detection.share, 0.8, 1e-12);
  EXPECT_NEAR(known[0].detection.trials, 800.0, 1e-9);
}

}  // namespace
}  // namespace shiftmap
