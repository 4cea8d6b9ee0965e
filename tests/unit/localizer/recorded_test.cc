// SPDX-License-Identifier: Apache-2.0
//
// Real data: MRCLAM data sets 1 and 2 share a frame, and 12 of 15 landmarks stand elsewhere in the
// second. On a map of both layouts that believes in the wrong one, a localizer has to find its
// pose, switch the modes, and stay close to motion capture.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>

#include "localizer/localizer.h"
#include "mapstore/run/trajectory.h"
#include "tools/convert/utias.h"

namespace shiftmap {
namespace {

std::string DatasetDir(int dataset) {
  const char* root = std::getenv("SHIFTMAP_DATA");
  const std::filesystem::path base = root ? root : "../shared/data";
  return base / "utias" / ("MRCLAM_Dataset" + std::to_string(dataset));
}

struct Case {
  int dataset;
  int robot;
  bool fleet_calibration;  // Else the defaults, as for a vehicle nobody calibrated.
};

// Both layouts as modes; `holds` is the number of the one that holds, by signature.
MapContent TwoLayouts(const Case& test_case, std::map<Signature, ModeNumber>* holds) {
  const auto first = ReadUtiasLandmarks(DatasetDir(1)).value();
  const auto second = ReadUtiasLandmarks(DatasetDir(2)).value();
  constexpr double kSame = 0.05;
  const Eigen::Matrix2d cov = Eigen::Matrix2d::Identity() * 0.0025;
  MapContent content;
  std::vector<Eigen::Matrix2d> marginals;
  for (const auto& [signature, p_first] : first) {
    LandmarkGroup group;
    group.signature = signature;
    group.modes.push_back({ModeNumber(1), p_first, cov, Stamp()});
    marginals.push_back(cov);
    const Eigen::Vector2d& p_second = second.at(signature);
    const bool moved = (p_first - p_second).norm() > kSame;
    if (moved) {
      group.modes.push_back({ModeNumber(2), p_second, cov, Stamp()});
      marginals.push_back(cov);
    }
    group.chain = ModeChain::Uniform(static_cast<int>(group.modes.size()), 1e-6);
    if (!moved) {
      group.probabilities = Eigen::Vector2d(0.02, 0.98);
    } else if (test_case.dataset == 1) {
      group.probabilities = Eigen::Vector3d(0.02, 0.08, 0.9);
    } else {
      group.probabilities = Eigen::Vector3d(0.02, 0.9, 0.08);
    }
    (*holds)[signature] = ModeNumber(moved ? test_case.dataset : 1);
    content.groups.push_back(group);
  }
  content.covariance = JointCovariance(marginals, {});
  if (test_case.fleet_calibration) {
    OdometryCalibration& odometry = content.calibration.odometry;
    odometry.scale_v = 0.92;
    odometry.scale_omega = 0.9;
    odometry.lag_s = 0.2;
    SensorCalibration& sensor = content.calibration.sensor;
    sensor.sd_range_m = 0.1;
    sensor.sd_bearing_rad = 0.02;
    sensor.max_range_m = 7.0;
    sensor.max_bearing_rad = 0.55;
    sensor.detection_probability = 0.35;
    sensor.range_curvature_per_rad2 = -0.49;
    sensor.mean_squared_bearing_rad2 = 0.08;
  }
  return content;
}

class RecordedShift : public ::testing::TestWithParam<Case> {};

TEST_P(RecordedShift, SwitchesModesAndStaysCloseToMotionCapture) {
  const Case test_case = GetParam();
  if (!std::filesystem::exists(DatasetDir(test_case.dataset))) {
    GTEST_SKIP() << "no data at " << DatasetDir(test_case.dataset) << ", set SHIFTMAP_DATA";
  }
  std::map<Signature, ModeNumber> holds;
  MapContent content = TwoLayouts(test_case, &holds);
  const auto recorded =
      ReadUtias({DatasetDir(test_case.dataset), test_case.robot, 0.0, std::nullopt});
  ASSERT_TRUE(recorded.ok()) << Message(recorded.status());
  const auto truth = ReadUtiasGroundtruth(DatasetDir(test_case.dataset), test_case.robot);
  ASSERT_TRUE(truth.ok()) << Message(truth.status());
  std::vector<StampedPose> motion_capture;
  for (const auto& pose : *truth) {
    motion_capture.push_back({pose.stamp, pose.T_map_vehicle});
  }
  content.stamp = recorded->run.odometry.front().stamp;

  Localizer localizer(MapSnapshot("hall", VersionNumber(1), "", content), {});
  double squares = 0.0;
  int compared = 0;
  for (const RunEvent& event : MergeEvents(recorded->run)) {
    ASSERT_TRUE(localizer.Process(event).ok());
    if (localizer.decisions().empty()) continue;
    for (const PoseEstimate& estimate : localizer.new_estimates()) {
      const auto T_map_vehicle = Interpolate(motion_capture, estimate.stamp, FromSeconds(0.3));
      if (!T_map_vehicle) continue;
      squares +=
          (T_map_vehicle->translation() - estimate.pose.T_map_vehicle.translation()).squaredNorm();
      ++compared;
    }
  }
  ASSERT_GT(compared, 1000);
  EXPECT_LT(std::sqrt(squares / compared), test_case.fleet_calibration ? 0.08 : 0.16);

  std::map<Signature, int> decided;
  for (const Decision& decision : localizer.decisions()) {
    EXPECT_EQ(decision.mode, holds.at(decision.signature)) << decision.signature.text();
    ++decided[decision.signature];
  }
  EXPECT_EQ(decided.size(), content.groups.size());
}

INSTANTIATE_TEST_SUITE_P(Mrclam,
                         RecordedShift,
                         ::testing::Values(Case{1, 1, true},
                                           Case{1, 2, true},
                                           Case{2, 1, true},
                                           Case{2, 2, true},
                                           Case{1, 1, false},
                                           Case{1, 2, false},
                                           Case{2, 1, false},
                                           Case{2, 2, false}));

}  // namespace
}  // namespace shiftmap
