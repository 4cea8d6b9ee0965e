// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/vehicle_fault.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <set>

#include "mapstore/map/shift_report_check.h"
#include "tests/support/random_map.h"
#include "tests/support/status_matchers.h"

namespace shiftmap {
namespace {

using testing::IsOk;

Run ThreeLandmarks() {
  Run run;
  run.odometry = {{Stamp(Duration(0)), 1.0, 0.1}, {Stamp(Duration(5)), 0.5, -0.1}};
  for (const char* const name : {"a", "b", "c", ""}) {
    Scan& scan = run.scans.emplace_back();
    scan.stamp = Stamp(Duration(std::ssize(run.scans)));
    Observation& seen = scan.observations.emplace_back();
    seen.signature = Signature(name);
    seen.z = {2.0, 0.0};
  }
  return run;
}

std::string Read(const Run& run, std::size_t scan) {
  return run.scans[scan].observations.front().signature.text();
}

TEST(VehicleFaultTest, CodesAreTakenForEachOther) {
  const shiftmap::Run misread = WithFault(ThreeLandmarks(), VehicleFault::kMisreadCodes);
  EXPECT_EQ(Read(misread, 0), "b");
  EXPECT_EQ(Read(misread, 1), "a");
  EXPECT_EQ(Read(misread, 2), "c");
  EXPECT_EQ(Read(misread, 3), "");
  const shiftmap::Run again = WithFault(misread, VehicleFault::kMisreadCodes);
  for (std::size_t scan = 0; scan < 4; ++scan) {
    EXPECT_EQ(Read(again, scan), Read(ThreeLandmarks(), scan));
  }
}

TEST(VehicleFaultTest, OdometersStandOrGoBackwards) {
  const shiftmap::Run frozen = WithFault(ThreeLandmarks(), VehicleFault::kFrozenOdometer);
  const shiftmap::Run reversed = WithFault(ThreeLandmarks(), VehicleFault::kReversedOdometer);
  EXPECT_EQ(frozen.odometry[1].v_mps, 0.0);
  EXPECT_EQ(frozen.odometry[1].omega_radps, 0.0);
  EXPECT_EQ(reversed.odometry[1].v_mps, -0.5);
  EXPECT_EQ(reversed.odometry[1].omega_radps, -0.1);
  EXPECT_EQ(WithFault(ThreeLandmarks(), VehicleFault::kFlood).odometry[1].v_mps, 0.5);
}

// The state that a visit favours.
ModeNumber Favoured(const VisitEvidence& visit) {
  return std::max_element(
             visit.modes.begin(),
             visit.modes.end(),
             [](const auto& a, const auto& b) { return a.log_likelihood < b.log_likelihood; })
      ->mode;
}

ShiftReport Honest() {
  ShiftReport report;
  report.uuid = "01234567-89ab-4def-8123-456789abcdef";
  report.vehicle = "v";
  report.area = "site";
  report.version = VersionNumber(1);
  report.content_hash = std::string(64, 'a');
  report.software = "test";
  report.begin = Stamp(FromSeconds(0.0));
  report.end = Stamp(FromSeconds(100.0));
  for (const int favoured : {0, 1, 2}) {
    VisitEvidence& visit = report.evidence.emplace_back();
    visit.signature = Signature(std::string(1, static_cast<char>('a' + favoured)));
    visit.begin = Stamp(FromSeconds(10.0 * favoured));
    visit.end = Stamp(FromSeconds(10.0 * favoured + 5.0));
    for (const int mode : {0, 1, 2}) {
      visit.modes.push_back({ModeNumber(mode), mode == favoured ? 0.0 : -3.0});
    }
  }
  return report;
}

TEST(VehicleFaultTest, FalseReportsAreAcceptedAndClaimOtherStates) {
  ASSERT_THAT(ValidateShiftReport(Honest()), IsOk());
  EXPECT_EQ(WithFault(Honest(), VehicleFault::kMisreadCodes).size(), 1u);
  const auto falsified = WithFault(Honest(), VehicleFault::kFalseReports);
  const auto flood = WithFault(Honest(), VehicleFault::kFlood);
  ASSERT_EQ(falsified.size(), 1u);
  ASSERT_GT(flood.size(), 10u);
  std::set<std::string> uuids;
  for (const auto* const reports : {&falsified, &flood}) {
    for (const ShiftReport& report : *reports) {
      EXPECT_THAT(ValidateShiftReport(report), IsOk());
      uuids.insert(report.uuid);
      ASSERT_EQ(report.evidence.size(), 3u);
      for (std::size_t i = 0; i < 3; ++i) {
        const ModeNumber claimed = Favoured(report.evidence[i]);
        EXPECT_NE(claimed, Favoured(Honest().evidence[i]));
      }
    }
  }
  EXPECT_EQ(uuids.size(), 1 + flood.size());
}

}  // namespace
}  // namespace shiftmap
