// SPDX-License-Identifier: Apache-2.0
//
// Recorded robots, four layouts known, the wrong one believed at 0.9, the start known to a metre
// and 0.3 rad: as good as a localizer that is told the layout. Skipped where the data is absent
// (SHIFTMAP_DATA).
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "tools/convert/utias.h"
#include "tools/experiment/localizer_utias.h"

namespace shiftmap {
namespace {

constexpr int kDatasets[] = {1, 2, 3, 6};
constexpr int kRobot = 2;

// What `shiftmap-mapper build` finds for robot 1 of data sets 1 and 2, rounded.
Calibration MappedCalibration() {
  Calibration calibration;
  calibration.odometry.scale_v = 0.95;
  calibration.odometry.scale_omega = 0.885;
  calibration.odometry.lag_s = 0.22;
  calibration.odometry.noise_v = 0.022;
  calibration.odometry.noise_omega = 0.027;
  calibration.sensor.sd_range_m = 0.09;
  calibration.sensor.sd_bearing_rad = 0.03;
  calibration.sensor.range_curvature_per_rad2 = -0.5;
  calibration.sensor.mean_squared_bearing_rad2 = 0.1;
  calibration.sensor.max_range_m = 7.2;
  calibration.sensor.max_bearing_rad = 0.55;
  calibration.sensor.detection_probability = 0.36;
  calibration.sensor.clutter_density_per_m2 = 1e-3;
  return calibration;
}

class DecisionUtias : public ::testing::TestWithParam<int> {};

TEST_P(DecisionUtias, AWrongLayoutBelievedCostsNoAccuracy) {
  const char* folder = std::getenv("SHIFTMAP_DATA");
  const std::string data = std::string(folder == nullptr ? "" : folder) + "/utias";
  if (!std::filesystem::exists(data + "/MRCLAM_Dataset1")) {
    GTEST_SKIP() << "no UTIAS data: set SHIFTMAP_DATA to the folder that holds utias";
  }
  std::vector<Layout> layouts;
  for (const int dataset : kDatasets) {
    layouts.push_back(
        ReadUtiasLandmarks(data + "/MRCLAM_Dataset" + std::to_string(dataset)).value());
  }
  const int layout = GetParam();
  const int believed = (layout + 1) % 4;
  const TrueShift shift = LoadUtiasShift(data, kDatasets[layout], kRobot, layout).value();
  const UtiasShiftResult result =
      LocalizeUtias(shift, layouts, believed, MappedCalibration(), {}, 1);
  EXPECT_GT(result.decisions, 15);
  EXPECT_EQ(result.wrong, 0);
  EXPECT_LE(result.median_observations, 5.0);
  EXPECT_LE(result.rmse_m, 1.1 * result.rmse_oracle_m);
  EXPECT_LT(result.rmse_oracle_m, 0.08);
  EXPECT_GT(result.rmse_stale_m, 5.0 * result.rmse_m);
}

INSTANTIATE_TEST_SUITE_P(Layouts, DecisionUtias, ::testing::Range(0, 4));

}  // namespace
}  // namespace shiftmap
