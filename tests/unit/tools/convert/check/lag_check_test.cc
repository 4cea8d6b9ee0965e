// SPDX-License-Identifier: Apache-2.0
//
// Simulated drives whose scans are stamped by a clock that is off by a known time.
#include "tools/convert/check/lag_check.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/tools/convert/check/simulated_drive.h"

namespace shiftmap {
namespace {

using testing::SimulatedDrive;

LagCheck Checked(const Run& run) {
  LagCheck check;
  testing::AddAll(run, &check);
  return check;
}

TEST(LagCheck, MeasuresByHowMuchScansAreLate) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    for (const double lag_s : {-2.0, -1.0, -0.5, -0.3, 0.3, 0.5, 1.0, 2.0}) {
      shiftmap::Run run = SimulatedDrive(seed);
      for (Scan& scan : run.scans) scan.stamp += FromSeconds(lag_s);
      const LagCheck check = Checked(run);
      ASSERT_TRUE(check.Lag()) << seed << ' ' << lag_s;
      EXPECT_NEAR(*check.Lag(), lag_s, 0.1) << seed;
      Findings findings;
      check.Report(&findings);
      ASSERT_EQ(findings.size(), 1U);
      EXPECT_EQ(findings[0].severity,
                std::abs(lag_s) > 0.45 ? Severity::kWarning : Severity::kNote);
      EXPECT_NE(findings[0].message.find(lag_s > 0.0 ? "later" : "earlier"), std::string::npos);
    }
  }
}

TEST(LagCheck, HasNothingToSayOfARightLog) {
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    Findings findings;
    Checked(SimulatedDrive(seed, 0.1)).Report(&findings);
    EXPECT_TRUE(findings.empty()) << seed << ": " << findings[0].message;
  }
}

// Motion at a constant twist is the same at any time.
TEST(LagCheck, AVehicleThatDoesNotChangeItsMotionShowsNone) {
  const Stamp begin = SimulatedDrive(1).odometry.front().stamp;
  shiftmap::Run steady;
  for (int i = 0; i < 3000; ++i) {
    const Stamp stamp = begin + FromSeconds(0.05 * i);
    steady.odometry.push_back({stamp, 1.0, 0.0});
    if (i % 10 != 0) continue;
    Scan scan;
    scan.stamp = stamp + FromSeconds(1.0);
    Observation observation;
    observation.signature = Signature("L");
    observation.kind = Observation::Kind::kCartesian;
    observation.z = Eigen::Vector2d(200.0 - 0.05 * i, 3.0);
    scan.observations.push_back(observation);
    steady.scans.push_back(scan);
  }
  EXPECT_FALSE(Checked(steady).Lag());
}

}  // namespace
}  // namespace shiftmap
