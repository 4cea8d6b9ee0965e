// SPDX-License-Identifier: Apache-2.0
#include "tools/convert/csv_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;
using testing::IsOk;
using testing::StatusIs;
using testing::TempDir;
using testing::WriteFile;

class CsvRunTest : public ::testing::Test {
 protected:
  CsvRunTest() {
    options_.odometry = dir_.File("odometry.csv");
    options_.observations = dir_.File("observations.csv");
    Odometry("stamp_s,v_mps,omega_radps\n10.5,1,0\n11,1.5,-0.25\n");
    Observations("stamp_s,signature,range_m,bearing_rad\n10.5,L1,2,0.5\n");
  }

  void Odometry(const std::string& text) const { WriteFile(options_.odometry, text); }
  void Observations(const std::string& text) const { WriteFile(options_.observations, text); }
  void ExpectRefused(const std::string& message) const {
    EXPECT_THAT(ReadCsvRun(options_).status(), StatusIs(StatusCode::kInvalidArgument, message));
  }

  TempDir dir_;
  CsvRunOptions options_;
};

TEST_F(CsvRunTest, ReadsColumnsInAnyOrder) {
  Odometry(
      "\xef\xbb\xbf# made by hand\r\nomega_radps, v_mps ,battery,stamp_s\r\n"
      "0.25,1.5,full,1767600000.000000001\r\n");
  Observations(
      "signature,sd_bearing_rad,stamp_s,bearing_rad,range_m,sd_range_m\n"
      "\"a,\"\"b\",0.02,5,-0.5,3,0.1\n"
      "'=L2,,5,0.25,4,\n"
      ",0.02,5,0,1,0.1\n"
      ",,6,,,\n");
  const auto csv = ReadCsvRun(options_);
  ASSERT_THAT(csv.status(), IsOk());
  const auto& odometry = csv->run.odometry;
  ASSERT_EQ(odometry.size(), 1U);
  EXPECT_EQ(ToNanoseconds(odometry[0].stamp), 1'767'600'000'000'000'001);
  EXPECT_EQ(odometry[0].v_mps, 1.5);
  EXPECT_EQ(odometry[0].omega_radps, 0.25);
  EXPECT_THAT(csv->ignored_columns, ElementsAre(options_.odometry + ": column 'battery'"));

  ASSERT_EQ(csv->run.scans.size(), 2U);
  const auto& seen = csv->run.scans[0].observations;
  ASSERT_EQ(seen.size(), 3U);
  EXPECT_EQ(seen[0].signature.text(), "a,\"b");
  EXPECT_EQ(seen[0].z, Eigen::Vector2d(3.0, -0.5));
  EXPECT_TRUE(seen[0].cov_z->isApprox(Eigen::Vector2d(0.01, 0.0004).asDiagonal().toDenseMatrix()));
  EXPECT_EQ(seen[1].signature.text(), "=L2");  // As a spreadsheet needs it.
  EXPECT_FALSE(seen[1].cov_z.has_value());
  EXPECT_EQ(seen[2].signature.text(), "");
  EXPECT_THAT(csv->run.scans[1].observations, IsEmpty());
}

TEST_F(CsvRunTest, ReadsPositionsAndTruth) {
  Observations("stamp_s,signature,x_m,y_m\n10.75,L1,-2,0.5\n");
  options_.truth = dir_.File("truth.csv");
  WriteFile(options_.truth, "stamp_s,x_m,y_m,yaw_rad\n10.5,1,2,0.5\n");
  const auto csv = ReadCsvRun(options_);
  ASSERT_THAT(csv.status(), IsOk());
  EXPECT_EQ(csv->run.scans[0].observations[0].kind, Observation::Kind::kCartesian);
  EXPECT_EQ(csv->run.scans[0].observations[0].z, Eigen::Vector2d(-2.0, 0.5));
  ASSERT_EQ(csv->truth.size(), 1U);
  EXPECT_EQ(csv->truth[0].T_map_vehicle.yaw(), 0.5);
}

TEST_F(CsvRunTest, NamesTheColumnsThatAreMissing) {
  Odometry("stamp_s,v\n1,1\n");
  ExpectRefused("odometry.csv:1: no column 'v_mps', 'omega_radps', there are 'stamp_s', 'v'");
  Odometry("stamp_s,v_mps,v_mps,omega_radps\n");
  ExpectRefused("odometry.csv:1: two columns 'v_mps'");
  Odometry("stamp_s,v_mps,omega_radps\n");
  ExpectRefused("no odometry");
  Odometry("");
  ExpectRefused("no row of names");
  Odometry("stamp_s,v_mps,omega_radps\n1,1,1\n");
  Observations("stamp_s,signature,range_m\n");
  ExpectRefused("observations.csv:1: no column 'bearing_rad'");
  Observations("stamp_s,signature,range_m,bearing_rad,sd_range_m\n");
  ExpectRefused("observations.csv:1: no column 'sd_bearing_rad'");
  Observations("stamp_s,signature\n");
  ExpectRefused("expected either columns 'range_m', 'bearing_rad' or columns 'x_m', 'y_m'");
  Observations("stamp_s,signature,range_m,bearing_rad,x_m,y_m\n");
  ExpectRefused("expected either columns");
}

TEST_F(CsvRunTest, NamesTheLineOfEachError) {
  const std::string head = "stamp_s,v_mps,omega_radps\n1,1,1\n";
  Odometry(head + "2,fast,1\n");
  ExpectRefused("odometry.csv:3: column 'v_mps': 'fast', expected a number");
  Odometry(head + "\n0.5,1,1\n");
  ExpectRefused("odometry.csv:4: time 0.5 goes backwards from 1.000000");
  Odometry(head + "2,1\n");
  ExpectRefused("odometry.csv:3: 2 cells, expected 3");
  Odometry(head + "1767600000000,1,1\n");
  ExpectRefused("odometry.csv:3: column 'stamp_s': '1767600000000', expected seconds");
  Odometry(head + "2,\"1,1\n");
  ExpectRefused("odometry.csv:3: ");
  Odometry(head + "2,1e10,1\n");
  ExpectRefused("odometry.csv:3: odometry at 2.000000 s");
  Odometry(head);
  const std::string names = "stamp_s,signature,range_m,bearing_rad,sd_range_m,sd_bearing_rad\n";
  Observations(names + "1,L,-2,0,1,1\n");
  ExpectRefused("observations.csv:2: scan at 1.000000 s: landmark 'L'");
  Observations(names + "1,L,2,0,0,1\n");
  ExpectRefused("observations.csv:2: column 'sd_range_m': 0, expected above 0");
  Observations(names + "1,L,2,0,1,\n");
  ExpectRefused("observations.csv:2: column 'sd_bearing_rad': ''");
}

}  // namespace
}  // namespace shiftmap
