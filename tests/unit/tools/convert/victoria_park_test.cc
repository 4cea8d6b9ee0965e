// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/victoria_park.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <numbers>

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

class VictoriaParkTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "shiftmap_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    folder_ = pattern;
    options_.dataset_dir = folder_.string();
    Put("controls.csv", "# t_s,speed_mps,steering_rad\n1.000,2.0,0.0\n1.025,2.0,0.2\n");
    Put("tree_detections.csv", "# scan,t_s,range_m,bearing_raw\n0,1.010,10.0,1.5707963267948966\n");
    Put("gps.csv", "# t_s,x_m,y_m\n1.0,-67.5,-41.25\n1.2,-67.0,-41.0\n");
  }
  void TearDown() override { fs::remove_all(folder_); }

  void Put(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }
  void ExpectError(StatusCode code, const std::string& part) const {
    const Status status = ReadVictoriaPark(options_).status();
    EXPECT_EQ(status.code(), code) << Message(status);
    EXPECT_NE(Message(status).find(part), std::string::npos) << Message(status);
  }

  fs::path folder_;
  VictoriaParkOptions options_;
};

TEST_F(VictoriaParkTest, SpeedIsThatOfTheMiddleOfTheAxle) {
  const auto park = ReadVictoriaPark(options_);
  ASSERT_TRUE(park.ok()) << Message(park.status());
  ASSERT_EQ(park->run.odometry.size(), 2U);
  EXPECT_EQ(park->run.odometry[0].v_mps, 2.0);
  EXPECT_EQ(park->run.odometry[0].omega_radps, 0.0);
  // The left wheel of a left turn is the inner one: v_wheel = v - ω·0.76.
  const OdometrySample& turning = park->run.odometry[1];
  EXPECT_NEAR(turning.v_mps - 0.76 * turning.omega_radps, 2.0, 1e-12);
  EXPECT_NEAR(turning.omega_radps, turning.v_mps * std::tan(0.2) / 2.83, 1e-12);
  EXPECT_GT(turning.v_mps, 2.0);
}

TEST_F(VictoriaParkTest, ObservationsAreInTheVehicleFrame) {
  Put("tree_detections.csv", "0,1.010,10.0,1.5707963267948966\n1,1.2,5.0,3.141592653589793\n");
  const auto park = ReadVictoriaPark(options_);
  ASSERT_TRUE(park.ok()) << Message(park.status());
  ASSERT_EQ(park->run.scans.size(), 2U);
  const Observation& ahead = park->run.scans[0].observations[0];
  EXPECT_TRUE(ahead.signature.anonymous());
  EXPECT_LT((ahead.PositionInVehicle() - Eigen::Vector2d(13.78, 0.5)).norm(), 1e-9);
  ASSERT_TRUE(ahead.cov_z.has_value());
  EXPECT_NEAR((*ahead.cov_z)(0, 0), std::pow(options_.sd_range_m, 2), 1e-9);
  EXPECT_NEAR((*ahead.cov_z)(1, 1), std::pow(10.0 * options_.sd_bearing_rad, 2), 1e-9);
  const Observation& left = park->run.scans[1].observations[0];
  EXPECT_LT((left.PositionInVehicle() - Eigen::Vector2d(3.78, 5.5)).norm(), 1e-9);
}

TEST_F(VictoriaParkTest, LeftoversOfEarlierScansAreDropped) {
  Put("tree_detections.csv",
      "0,1.0,10.0,0.5\n0,1.0,11.0,1.0\n0,1.0,12.0,1.5\n"
      "1,1.2,10.1,0.6\n1,1.2,11.0,1.0\n1,1.2,12.0,1.5\n"    // One new, two old.
      "2,1.4,10.1,0.6\n2,1.4,11.1,1.1\n2,1.4,12.0,1.5\n"    // Two, the first as it was.
      "3,1.6,10.1,0.6\n3,1.6,11.1,1.1\n3,1.6,12.0,1.5\n");  // Nothing new.
  const auto park = ReadVictoriaPark(options_);
  ASSERT_TRUE(park.ok()) << Message(park.status());
  std::vector<std::size_t> counts;
  for (const Scan& scan : park->run.scans) counts.push_back(scan.observations.size());
  EXPECT_EQ(counts, (std::vector<std::size_t>{3, 1, 2, 0}));
  EXPECT_EQ(park->detection_rows, 12);
  EXPECT_EQ(park->stale_rows, 6);
}

TEST_F(VictoriaParkTest, ReadsFixes) {
  const auto fixes = ReadVictoriaParkGps(options_.dataset_dir);
  ASSERT_TRUE(fixes.ok()) << Message(fixes.status());
  ASSERT_EQ(fixes->size(), 2U);
  EXPECT_EQ((*fixes)[0].p_gps_antenna, Eigen::Vector2d(-67.5, -41.25));
}

TEST_F(VictoriaParkTest, SaysWhatIsWrong) {
  Put("tree_detections.csv", "0,1.0,10.0,0.5\n1,0.9,10.0,0.5\n");
  ExpectError(StatusCode::kInvalidArgument, "tree_detections.csv:2: time 0.9 goes backwards");
  Put("tree_detections.csv", "0,1.0,-1.0,0.5\n");
  ExpectError(StatusCode::kInvalidArgument, "range -1");
  Put("controls.csv", "1.0,2.0\n");
  ExpectError(StatusCode::kInvalidArgument, "controls.csv:1: 2 fields, expected 3");
  Put("controls.csv", "1.0,2.0,1.5\n");
  ExpectError(StatusCode::kInvalidArgument, "steering");
  fs::remove(folder_ / "controls.csv");
  ExpectError(StatusCode::kNotFound, "controls.csv");
  options_.dataset_dir = (folder_ / "none").string();
  ExpectError(StatusCode::kNotFound, "no such folder");
  options_.sd_range_m = 0.0;
  ExpectError(StatusCode::kInvalidArgument, "sd_range_m");
}

// That stale rows are told from others shows in the recording itself: what is left ascends in
// bearing in every scan.
TEST(VictoriaParkData, DetectionsAscendInBearing) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const fs::path root = fs::path(data != nullptr ? data : "../shared/data") / "victoria_park";
  if (!fs::exists(root)) GTEST_SKIP() << "no data at '" << root.string() << "'; set SHIFTMAP_DATA";
  VictoriaParkOptions options;
  options.dataset_dir = root.string();
  const auto park = ReadVictoriaPark(options);
  ASSERT_TRUE(park.ok()) << Message(park.status());
  EXPECT_EQ(park->run.scans.size(), 7249U);
  EXPECT_EQ(park->detection_rows, 126803);
  EXPECT_EQ(park->stale_rows, 73899);
  for (const Scan& scan : park->run.scans) {
    double last = -std::numbers::pi;
    for (const Observation& observation : scan.observations) {
      const Eigen::Vector2d q = observation.z - kVictoriaParkLaser;
      const double bearing = std::atan2(q.y(), q.x());
      EXPECT_GT(bearing, last);
      last = bearing;
    }
  }
}

}  // namespace
}  // namespace shiftmap
