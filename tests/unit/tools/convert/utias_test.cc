// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/utias.h"

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

namespace shiftmap {
namespace {

namespace fs = std::filesystem;

// A made-up data set in a folder of its own: one robot seen, one barcode that no list names.
class UtiasTest : public testing::Test {
 protected:
  void SetUp() override {
    std::string pattern = (fs::temp_directory_path() / "shiftmap_XXXXXX").string();
    ASSERT_NE(mkdtemp(pattern.data()), nullptr);
    root_ = pattern;
    folder_ = root_ / "MRCLAM_Dataset9";
    fs::create_directory(folder_);
    Put("Barcodes.dat",
        "# Subject #    Barcode #\n  1 \t   5\n  2 \t  14\n  6 \t  72\n  7 \t  18\n");
    Put("Landmark_Groundtruth.dat",
        "  6 \t 1.5 \t -2.5 \t 0.001 \t 0.001\n  7 \t 3 \t 4 \t 0 \t 0\n");
    Put("Robot2_Odometry.dat",
        "# Time [s]    forward velocity [m/s]    angular velocity[rad/s]\n"
        "100.500 \t  0.1 \t -0.2\n101.500 \t  0.3 \t  0.0\r\n\n102.500 \t  0.5 \t  0.1\n");
    Put("Robot2_Measurement.dat",
        "100.600 \t  72 \t  2.5 \t  0.25\n"
        "100.600 \t   5 \t  1.0 \t  0.0\n"
        "100.600 \t  18 \t  3.5 \t -0.5\n"
        "101.600 \t  99 \t  3.0 \t  0.1\n"
        "102.600 \t  18 \t  4.0 \t  0.2\n");
    Put("Robot2_Groundtruth.dat", "100.123456789 1.0 2.0 0.5\n100.2 1.5 2.5 -0.5\n");
    options_.dataset_dir = folder_.string();
    options_.robot = 2;
  }
  void TearDown() override { fs::remove_all(root_); }

  void Put(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name) << text;
  }
  void ExpectError(StatusCode code, const std::string& part) const {
    const Status status = ReadUtias(options_).status();
    EXPECT_EQ(status.code(), code) << Message(status);
    EXPECT_NE(Message(status).find(part), std::string::npos) << Message(status);
  }

  fs::path root_;
  fs::path folder_;
  UtiasOptions options_;
};

TEST_F(UtiasTest, ReadsARun) {
  const auto utias = ReadUtias(options_);
  ASSERT_TRUE(utias.ok()) << Message(utias.status());
  const shiftmap::Run& run = utias->run;
  EXPECT_EQ(run.info.vehicle, "mrclam_robot2");
  EXPECT_EQ(run.info.source, "utias MRCLAM_Dataset9 robot 2");
  ASSERT_EQ(run.odometry.size(), 3U);
  EXPECT_EQ(ToNanoseconds(run.odometry[0].stamp), 100'500'000'000);
  EXPECT_EQ(run.odometry[1].v_mps, 0.3);
  EXPECT_EQ(run.odometry[0].omega_radps, -0.2);

  ASSERT_EQ(run.scans.size(), 3U);
  ASSERT_EQ(run.scans[0].observations.size(), 2U);
  EXPECT_EQ(run.scans[0].observations[0].signature, Signature("72"));
  EXPECT_EQ(run.scans[0].observations[0].kind, Observation::Kind::kRangeBearing);
  EXPECT_EQ(run.scans[0].observations[0].z, Eigen::Vector2d(2.5, 0.25));
  EXPECT_EQ(run.scans[0].observations[1].signature, Signature("18"));
  EXPECT_TRUE(run.scans[1].observations.empty());
  EXPECT_EQ(ToNanoseconds(run.scans[2].stamp), 102'600'000'000);

  EXPECT_EQ(utias->odometry_rows, 3);
  EXPECT_EQ(utias->measurement_rows, 5);
  EXPECT_EQ(utias->robot_measurements, 1);
  EXPECT_EQ(utias->unlisted_measurements, 1);
}

TEST_F(UtiasTest, NamesTheFolderWhateverItsSpelling) {
  for (const char* spelling : {"/", "/.", "/../MRCLAM_Dataset9", "//"}) {
    options_.dataset_dir = folder_.string() + spelling;
    const auto utias = ReadUtias(options_);
    ASSERT_TRUE(utias.ok());
    EXPECT_EQ(utias->run.info.source, "utias MRCLAM_Dataset9 robot 2") << spelling;
  }
}

TEST_F(UtiasTest, CutsAStretchFromTheFirstOdometryOn) {
  options_.start_s = 1.0;
  options_.duration_s = 1.0;  // [101.5, 102.5)
  const auto utias = ReadUtias(options_);
  ASSERT_TRUE(utias.ok()) << Message(utias.status());
  ASSERT_EQ(utias->run.odometry.size(), 1U);
  EXPECT_EQ(utias->run.odometry[0].v_mps, 0.3);
  ASSERT_EQ(utias->run.scans.size(), 1U);
  EXPECT_EQ(utias->measurement_rows, 1);
  EXPECT_EQ(utias->robot_measurements, 0);
  EXPECT_EQ(utias->unlisted_measurements, 1);

  options_.start_s = 3.0;
  ExpectError(StatusCode::kInvalidArgument, "no odometry");
  options_.start_s = -1.0;
  ExpectError(StatusCode::kInvalidArgument, "stretch");
}

TEST_F(UtiasTest, NamesTheRowThatIsWrong) {
  const auto expect_row = [this](const std::string& name, const std::string& text, int line) {
    const fs::path path = folder_ / name;
    const std::string backup = (root_ / "backup").string();
    fs::copy_file(path, backup, fs::copy_options::overwrite_existing);
    Put(name, text);
    ExpectError(StatusCode::kInvalidArgument, path.string() + ":" + std::to_string(line) + ": ");
    fs::copy_file(backup, path, fs::copy_options::overwrite_existing);
  };
  expect_row("Robot2_Odometry.dat", "# comment\n100.5 0.1\n", 2);
  expect_row("Robot2_Odometry.dat", "100.5 0.1 0.2\n100.5 fast 0.2\n", 2);
  expect_row("Robot2_Odometry.dat", "100.5 0.1 0.2\n100.4 0.1 0.2\n", 2);
  expect_row("Robot2_Odometry.dat", "100.5 0.1 nan\n", 1);
  expect_row("Robot2_Measurement.dat", "100.6 72 2.5 0.25 7\n", 1);
  expect_row("Robot2_Measurement.dat", "100.6 7.2 2.5 0.25\n", 1);
  expect_row("Robot2_Measurement.dat", "100.6 72 0 0.25\n", 1);
  expect_row("Robot2_Measurement.dat", "1e2 72 1 0.25\n", 1);
  expect_row("Barcodes.dat", "1 5\n6 72\n7 72\n", 3);
}

TEST_F(UtiasTest, NamesWhatIsMissing) {
  options_.robot = 1;
  ExpectError(StatusCode::kNotFound, "Robot1_Odometry.dat");
  options_.robot = 6;
  ExpectError(StatusCode::kInvalidArgument, "robot 6");
  options_.robot = 2;
  options_.dataset_dir += "x";
  ExpectError(StatusCode::kNotFound, options_.dataset_dir);
  EXPECT_EQ(ReadUtiasLandmarks(options_.dataset_dir).status().code(), StatusCode::kNotFound);
  EXPECT_EQ(ReadUtiasGroundtruth(options_.dataset_dir, 2).status().code(), StatusCode::kNotFound);
}

TEST_F(UtiasTest, ReadsTruth) {
  const auto poses = ReadUtiasGroundtruth(options_.dataset_dir, 2);
  ASSERT_TRUE(poses.ok()) << Message(poses.status());
  ASSERT_EQ(poses->size(), 2U);
  EXPECT_EQ(ToNanoseconds((*poses)[0].stamp), 100'123'456'789);
  EXPECT_EQ((*poses)[1].T_map_vehicle.translation(), Eigen::Vector2d(1.5, 2.5));
  EXPECT_EQ((*poses)[1].T_map_vehicle.yaw(), -0.5);

  const auto landmarks = ReadUtiasLandmarks(options_.dataset_dir);
  ASSERT_TRUE(landmarks.ok()) << Message(landmarks.status());
  ASSERT_EQ(landmarks->size(), 2U);
  EXPECT_EQ(landmarks->at(Signature("72")), Eigen::Vector2d(1.5, -2.5));
  EXPECT_EQ(landmarks->at(Signature("18")), Eigen::Vector2d(3.0, 4.0));
}

// The published data, where it is at hand.
TEST(UtiasData, ReadsDataSets1And2) {
  const char* data = std::getenv("SHIFTMAP_DATA");
  const fs::path root = fs::path(data != nullptr ? data : "../shared/data") / "utias";
  if (!fs::exists(root)) GTEST_SKIP() << "no data at '" << root.string() << "'; set SHIFTMAP_DATA";
  for (const int set : {1, 2}) {
    UtiasOptions options;
    options.dataset_dir = (root / fmt::format("MRCLAM_Dataset{}", set)).string();
    const auto utias = ReadUtias(options);
    ASSERT_TRUE(utias.ok()) << Message(utias.status());
    EXPECT_TRUE(ValidateRun(utias->run).ok());
    EXPECT_EQ(utias->odometry_rows, set == 1 ? 97'890 : 121'742);
    EXPECT_EQ(utias->measurement_rows, set == 1 ? 5'723 : 8'753);
    EXPECT_GT(utias->robot_measurements, 0);
    EXPECT_LT(utias->unlisted_measurements, 10);
    std::int64_t kept = 0;
    for (const Scan& scan : utias->run.scans) kept += std::ssize(scan.observations);
    EXPECT_EQ(kept + utias->robot_measurements + utias->unlisted_measurements,
              utias->measurement_rows);
    const auto landmarks = ReadUtiasLandmarks(options.dataset_dir);
    ASSERT_TRUE(landmarks.ok()) << Message(landmarks.status());
    EXPECT_EQ(landmarks->size(), 15U);
    const auto poses = ReadUtiasGroundtruth(options.dataset_dir, 1);
    ASSERT_TRUE(poses.ok()) << Message(poses.status());
    EXPECT_GT(poses->size(), 80'000U);
  }
}

}  // namespace
}  // namespace shiftmap
