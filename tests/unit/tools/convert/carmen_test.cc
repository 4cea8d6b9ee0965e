// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/carmen.h"

#include <gtest/gtest.h>

#include <string>

#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

constexpr char kOdometry[] = "ODOM 1.0 2.0 0.5 0.1 0.0 0.0 10.25 host 3.0\n";
constexpr char kFrontLaser[] = "FLASER 3 1.0 2.0 81.9 9 9 9 1.5 2.5 -0.5 10.5 host 3.2\n";
constexpr char kRobotLaser[] =
    "ROBOTLASER1 0 -1.57079 3.14159 0.0174 50.0 0.01 0 2 1.5 2.5 1 7 9 9 9 "
    "3.0 4.0 1.5 0.1 0.2 0.3 0.4 0.0 11.0 host 3.7\n";

class CarmenTest : public ::testing::Test {
 protected:
  StatusOr<LidarLog> Read(const std::string& text) const {
    testing::WriteFile(path_, text);
    return ReadCarmen(path_);
  }
  void ExpectError(const std::string& text, const std::string& part) const {
    const Status status = Read(text).status();
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument) << Message(status);
    EXPECT_NE(Message(status).find(part), std::string::npos) << Message(status);
  }

  testing::TempDir folder_;
  std::string path_ = folder_.File("robot.log");
};

TEST_F(CarmenTest, ReadsOdometryAndTheFrontLaser) {
  const auto log = Read(std::string("# CARMEN Logfile\nPARAM robot_max_vel 1.0\n") + kFrontLaser +
                        kOdometry + "RLASER 1 2.0\n");
  ASSERT_TRUE(log.ok()) << Message(log.status());
  EXPECT_EQ(log->skipped_rows, 2);
  ASSERT_EQ(log->poses.size(), 2U);
  EXPECT_EQ(log->poses[0].stamp, StampFromSeconds(10.25));  // Sorted.
  EXPECT_EQ(log->poses[0].T_map_vehicle.translation(), Eigen::Vector2d(1.0, 2.0));
  EXPECT_EQ(log->poses[0].T_map_vehicle.yaw(), 0.5);
  EXPECT_EQ(log->poses[1].T_map_vehicle.translation(), Eigen::Vector2d(1.5, 2.5));
  EXPECT_EQ(log->poses[1].T_map_vehicle.yaw(), -0.5);
  ASSERT_EQ(log->scans.size(), 1U);
  EXPECT_EQ(log->scans[0].stamp, StampFromSeconds(10.5));
  EXPECT_EQ(log->scans[0].ranges_m, (std::vector<double>{1.0, 2.0, 81.9}));
  EXPECT_FALSE(log->max_range_m.has_value());
}

TEST_F(CarmenTest, ReadsARobotLaserWithWhatItSaysOfItself) {
  const auto log = Read(std::string(kRobotLaser) + kFrontLaser);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  EXPECT_EQ(log->skipped_rows, 1);  // The same sensor once more.
  ASSERT_EQ(log->scans.size(), 1U);
  EXPECT_EQ(log->scans[0].stamp, StampFromSeconds(11.0));
  EXPECT_EQ(log->scans[0].ranges_m, (std::vector<double>{1.5, 2.5}));
  ASSERT_EQ(log->poses.size(), 1U);
  EXPECT_EQ(log->poses[0].T_map_vehicle.translation(), Eigen::Vector2d(3.0, 4.0));
  EXPECT_EQ(log->field_of_view_rad, 3.14159);
  EXPECT_EQ(log->max_range_m, 50.0);
}

TEST_F(CarmenTest, SaysWhatIsWrong) {
  ExpectError("ODOM 1.0 2.0 0.5 0.1 0.0 0.0 10.25 host\n", "robot.log:1: 9 fields, expected more");
  ExpectError("ODOM 1.0 2.0 0.5 0.1 0.0 0.0 10.25 host 3 4\n", ":1: 11 fields, expected 10");
  ExpectError("ODOM 1.0 2.0 half 0.1 0.0 0.0 10.25 host 3\n", "'half', expected a number");
  ExpectError("ODOM 1.0 2.0 0.5 0.1 0.0 0.0 soon host 3\n", "'soon', expected seconds");
  ExpectError(std::string(kOdometry) + "FLASER 40 1.0 2.0 0 0 0 0 0 0 1.0 host 2.0\n",
              ":2: 40 values announced, expected 2..11");
  ExpectError("FLASER -1 1.0 2.0 0 0 0 0 0 0 1.0 host 2.0\n", "-1 values announced");
  ExpectError("FLASER 2 1.0 nan 0 0 0 0 0 0 1.0 host 2.0\n", "'nan', expected a number");
  ExpectError("FLASER\n", "1 fields, expected more");
  ExpectError(
      "ROBOTLASER1 0 -1.0 3.14159 0.0174 50.0 0.01 0 2 1.5 2.5 0 9 9 9 3 4 1 0 0 0 0 0 "
      "11.0 host 3.7\n",
      "half of it to each side");
  std::string other = kRobotLaser;
  other.replace(other.find("50.0"), 4, "60.0");
  ExpectError(kRobotLaser + other, ":2: maximum range 60, and 50 before");
  EXPECT_EQ(ReadCarmen(folder_.File("none")).status().code(), StatusCode::kNotFound);
}

TEST_F(CarmenTest, AnEmptyLogMakesNoRun) {
  const auto log = Read(kOdometry);
  ASSERT_TRUE(log.ok());
  const Status status = MakeLidarRun(*log, "robot", {}).status();
  EXPECT_EQ(status.code(), StatusCode::kInvalidArgument);
  EXPECT_NE(Message(status).find("no scan"), std::string::npos);
}

}  // namespace
}  // namespace shiftmap
