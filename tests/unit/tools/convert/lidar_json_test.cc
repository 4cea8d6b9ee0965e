// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/lidar_json.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

class LidarJsonTest : public ::testing::Test {
 protected:
  void ExpectError(const std::string& text, const std::string& part) const {
    testing::WriteFile(path_, text);
    const Status status = ReadLidarJson(path_).status();
    EXPECT_EQ(status.code(), StatusCode::kInvalidArgument) << Message(status);
    EXPECT_NE(Message(status).find(part), std::string::npos) << Message(status);
    EXPECT_NE(Message(status).find(path_), std::string::npos) << Message(status);
    EXPECT_EQ(Message(status).find('\n'), std::string::npos) << Message(status);
  }
  // One scan with that text.
  void ExpectScanError(const std::string& scan, const std::string& part) const {
    ExpectError(R"({"map": {"7.5": )" + scan + "}}", part);
  }

  testing::TempDir folder_;
  std::string path_ = folder_.File("log.json");
};

TEST_F(LidarJsonTest, ReadsScansInTheOrderOfTheirTimes) {
  testing::WriteFile(path_, R"({"map": {
      "100.000001": {"range": [1.5, 2], "x": 1, "y": -2.5, "theta": 0.25},
      "99.5": {"range": [3.5, 80.0, 0], "x": 0, "y": 0, "theta": 0}}})");
  const auto log = ReadLidarJson(path_);
  ASSERT_TRUE(log.ok()) << Message(log.status());
  EXPECT_EQ(log->name, "log.json");
  ASSERT_EQ(log->scans.size(), 2U);
  ASSERT_EQ(log->poses.size(), 2U);
  EXPECT_EQ(ToNanoseconds(log->scans[0].stamp), 99'500'000'000);
  EXPECT_EQ(ToNanoseconds(log->scans[1].stamp), 100'000'001'000);
  EXPECT_EQ(log->poses[1].stamp, log->scans[1].stamp);
  EXPECT_EQ(log->scans[0].ranges_m, (std::vector<double>{3.5, 80.0, 0.0}));
  EXPECT_EQ(log->poses[1].T_map_vehicle.translation(), Eigen::Vector2d(1.0, -2.5));
  EXPECT_EQ(log->poses[1].T_map_vehicle.yaw(), 0.25);
  EXPECT_FALSE(log->field_of_view_rad.has_value());
}

TEST_F(LidarJsonTest, SaysWhatIsWrong) {
  ExpectError("", "log.json:1: no JSON at column 1");
  ExpectError("{\"map\":\n  {\"1.0\": [1 2]}}", "log.json:2: no JSON at column 14");
  ExpectError(R"({"map": {"1.0": {"x": 1e999}}})", "out of range");
  ExpectError("[]", "no object 'map'");
  ExpectError(R"({"map": []})", "no object 'map'");
  ExpectError(R"({"scans": {}})", "no object 'map'");
  ExpectError(R"({"map": {"noon": {"range": [1, 2], "x": 0, "y": 0, "theta": 0}}})", "scan 'noon'");
  ExpectScanError("3", "scan '7.5': is of type number");
  ExpectScanError(R"({"range": [1, 2], "y": 0, "theta": 0})", "scan '7.5': no 'x'");
  ExpectScanError(R"({"range": [1, 2], "x": 0, "y": "0", "theta": 0})", "'y' is of type string");
  ExpectScanError(R"({"range": [1], "x": 0, "y": 0, "theta": 0})", "two numbers");
  ExpectScanError(R"({"range": 1, "x": 0, "y": 0, "theta": 0})", "two numbers");
  ExpectScanError(R"({"range": [1, null], "x": 0, "y": 0, "theta": 0})", "'range' has a null");
  ExpectError(R"({"map": {"1.0": {"range": [1, 2], "x": 0, "y": 0, "theta": 0},
                           "1.00": {"range": [1, 2], "x": 0, "y": 0, "theta": 0}}})",
              "two scans at 1.000000");
  EXPECT_EQ(ReadLidarJson(folder_.File("none")).status().code(), StatusCode::kNotFound);
}

TEST(LidarJsonData, HoldsTheIntelLog) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const fs::path root = fs::path(data != nullptr ? data : "../shared/data") / "lidar";
  if (!fs::exists(root)) GTEST_SKIP() << "no data at '" << root.string() << "'; set SHIFTMAP_DATA";
  const auto log = ReadLidarJson((root / "intel_gfs.json").string());
  ASSERT_TRUE(log.ok()) << Message(log.status());
  ASSERT_EQ(log->scans.size(), 910U);
  for (const RangeScan& scan : log->scans) ASSERT_EQ(scan.ranges_m.size(), 180U);
  const auto run = MakeLidarRun(*log, "intel", {});
  ASSERT_TRUE(run.ok()) << Message(run.status());
  std::size_t observations = 0;
  for (const Scan& scan : run->scans) observations += scan.observations.size();
  EXPECT_GT(observations, 6000U);
  EXPECT_LT(observations, 12000U);
}

}  // namespace
}  // namespace shiftmap
