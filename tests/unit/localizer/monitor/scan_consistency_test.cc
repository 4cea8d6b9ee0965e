// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/scan_consistency.h"

#include <gtest/gtest.h>

#include "tests/support/status_matchers.h"
#include "tests/support/temp_dir.h"

namespace shiftmap {
namespace {

using testing::IsOk;
using testing::StatusIs;

std::vector<ScanConsistency> TwoScans() {
  std::vector<ScanConsistency> scans(2);
  scans[0].stamp = StampFromSeconds(1767938400.25);
  scans[1].stamp = StampFromSeconds(1767938400.5);
  scans[1].pose.T_map_vehicle = Se2(1.0 / 3.0, -2e6, 3.0);
  scans[1].pose.cov_T_map_vehicle << 1.0, 0.1, 0.2, 0.1, 2.0, 0.3, 0.2, 0.3, 3.0;
  scans[1].nis = 5.5;
  scans[1].dof = 6;
  return scans;
}

TEST(ScanConsistency, SurviveARoundTrip) {
  const testing::TempDir folder;
  const std::string path = folder.File("nis.csv");
  const std::vector<ScanConsistency> written = TwoScans();
  ASSERT_THAT(WriteScanConsistency(written, path), IsOk());
  const auto read = ReadScanConsistency(path);
  ASSERT_THAT(read, IsOk());
  ASSERT_EQ(read->size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) {
    const ScanConsistency& a = written[i];
    const ScanConsistency& b = (*read)[i];
    EXPECT_NEAR(ToSecondsSinceEpoch(a.stamp), ToSecondsSinceEpoch(b.stamp), 1e-6);
    EXPECT_EQ(a.pose.T_map_vehicle.x(), b.pose.T_map_vehicle.x());
    EXPECT_EQ(a.pose.T_map_vehicle.y(), b.pose.T_map_vehicle.y());
    EXPECT_EQ(a.pose.cov_T_map_vehicle, b.pose.cov_T_map_vehicle);
    EXPECT_EQ(a.nis, b.nis);
    EXPECT_EQ(a.dof, b.dof);
  }
}

TEST(ScanConsistency, NameTheLineThatIsWrong) {
  const testing::TempDir folder;
  const std::string path = folder.File("nis.csv");
  ASSERT_THAT(WriteScanConsistency(TwoScans(), path), IsOk());
  const std::string good = testing::ReadFile(path);
  const std::string second = good.substr(good.rfind('\n', good.size() - 2) + 1);
  const std::string header = good.substr(0, good.find('\n') + 1);
  const auto expect = [&](const std::string& text, const std::string& what) {
    testing::WriteFile(path, text);
    EXPECT_THAT(ReadScanConsistency(path), StatusIs(StatusCode::kInvalidArgument, what));
  };
  expect("", "no scan");
  expect(header, "no scan");
  expect("a,b\n1,2\n", ":1': no column stamp_s");
  expect(good + "1,2\n", ":4'");
  expect(header + "x" + second, ":2'");
  expect(header + "1e300" + second.substr(second.find(',')), ":2'");
  expect(header + second + good.substr(header.size(), good.size() - header.size()), ":3'");
  EXPECT_THAT(ReadScanConsistency(folder.File("none")), StatusIs(StatusCode::kNotFound, "none"));
}

}  // namespace
}  // namespace shiftmap
