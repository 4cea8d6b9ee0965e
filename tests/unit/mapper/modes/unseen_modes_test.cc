// SPDX-License-Identifier: Apache-2.0
#include "mapper/modes/unseen_modes.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "mapstore/map/shift_report_check.h"

namespace shiftmap {
namespace {

Stamp At(double seconds) { return StampFromSeconds(1.7e9 + seconds); }

// A run along the x axis, a metre a second, looking ahead.
RunRecord RunAlongX(double begin_s, double seconds) {
  RunRecord run{"run", "hash", "truck", At(begin_s), At(begin_s + seconds), {}};
  for (double t = 0.0; t <= seconds; t += 0.5) {
    run.trajectory.push_back({At(begin_s + t), Se2(t, 0.0, 0.0)});
  }
  return run;
}

SensorCalibration Sensor() {
  SensorCalibration sensor;
  sensor.max_range_m = 10.0;
  sensor.max_bearing_rad = 1.0;
  sensor.detection_probability = 0.9;
  sensor.occluded_visit_probability = 0.05;
  return sensor;
}

NewMode ModeAt(double x, double y, int number = 2) {
  return {Signature("A"), ModeNumber(number), {x, y}, {}};
}

TEST(FindUnseenModes, APassOverANewPlaceSpeaksAgainstIt) {
  const std::vector<RunRecord> older =
      FindUnseenModes({RunAlongX(0.0, 20.0)}, {ModeAt(12.0, 1.0)}, {}, 10.0, Sensor(), {});
  ASSERT_EQ(older.size(), 1u);
  EXPECT_EQ(older[0].sha256, "hash");
  EXPECT_TRUE(older[0].trajectory.empty());
  ASSERT_EQ(older[0].evidence.size(), 1u);
  const VisitEvidence& visit = older[0].evidence[0];
  EXPECT_EQ(visit.observations, 0);
  EXPECT_GE(visit.begin, At(2.0));
  EXPECT_LE(visit.end, At(12.0));
  ASSERT_EQ(visit.modes.size(), 2u);
  EXPECT_EQ(visit.modes[0].log_likelihood, 0.0);
  EXPECT_EQ(visit.modes[1].mode, ModeNumber(2));
  // One pass proves no more than that it is not hidden.
  EXPECT_LT(visit.modes[1].log_likelihood, -1.0);
  EXPECT_GT(visit.modes[1].log_likelihood, std::log(0.05));
}

TEST(FindUnseenModes, APlaceOutOfViewSaysNothing) {
  EXPECT_TRUE(
      FindUnseenModes(
          {RunAlongX(0.0, 20.0)}, {ModeAt(-5.0, 0.0), ModeAt(10.0, 40.0)}, {}, 10.0, Sensor(), {})
          .empty());
}

TEST(FindUnseenModes, VisitsOfOneRunDifferInTime) {
  EvidenceRow row{"hash", {Signature("A"), At(1.0), At(2.0), {}, 3}, "truck"};
  const auto find = [&] {
    return FindUnseenModes({RunAlongX(0.0, 20.0)}, {ModeAt(12.0, 1.0)}, {row}, 10.0, Sensor(), {});
  };
  const VisitEvidence alone = find()[0].evidence[0];
  row.evidence.begin = alone.begin;
  row.evidence.end = alone.end;
  EXPECT_NE(find()[0].evidence[0].begin, alone.begin);
}

TEST(FindUnseenModes, ManyPassesSayNoMoreThanTheLedgerTakes) {
  RunRecord run{"run", "hash", "truck", At(0.0), At(6000.0), {}};
  for (int lap = 0; lap < 100; ++lap) {
    for (const StampedPose& pose : RunAlongX(60.0 * lap, 20.0).trajectory) {
      run.trajectory.push_back(pose);
    }
  }
  NewMode mode = ModeAt(12.0, 1.0);
  mode.scans.seen.fill(100);  // It shows from where the run passed.
  const std::vector<RunRecord> older = FindUnseenModes({run}, {mode}, {}, 10.0, Sensor(), {});
  ASSERT_EQ(older.size(), 1u);
  EXPECT_EQ(older[0].evidence[0].modes[1].log_likelihood, -kMaxVisitLogRatio);
}

TEST(FindUnseenModes, ModesOfALandmarkShareAVisit) {
  const std::vector<RunRecord> older =
      FindUnseenModes({RunAlongX(0.0, 20.0)},
                      {ModeAt(12.0, 1.0, 2), ModeAt(15.0, -1.0, 3)},
                      {},
                      10.0,
                      Sensor(),
                      {});
  ASSERT_EQ(older.size(), 1u);
  ASSERT_EQ(older[0].evidence.size(), 1u);
  EXPECT_EQ(older[0].evidence[0].modes.size(), 3u);
}

}  // namespace
}  // namespace shiftmap
