// SPDX-License-Identifier: Apache-2.0
#include "mapper/calibration/detection.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

#include "mapper/run_maps/single_run.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

// A vehicle that stands at the origin, and at each second sees of the landmarks ahead of it those
// that `seen` says.
struct StandingRun {
  explicit StandingRun(const std::vector<std::vector<int>>& seen) {
    data.odometry.push_back({});
    for (std::size_t f = 0; f < seen.size(); ++f) {
      const Stamp stamp = Stamp() + FromSeconds(static_cast<double>(f));
      data.frames.push_back({stamp, data.sightings.end_index(), static_cast<int>(seen[f].size())});
      run.poses.emplace_back();
      for (const int group : seen[f]) {
        Observation observation;
        observation.z = {1.0 + group, 0.0};
        data.sightings.push_back({FrameIndex(f), VisitOf(GroupIndex(group), stamp), observation});
      }
    }
    run.data = &data;
    run.assignment.assign(data.visits.size(), GroupModeIndex(0));
    build.modes.resize(3);
    for (int group = 0; group < 3; ++group) {
      build.modes[GroupIndex(group)] = {{{1.0 + group, 0.0}, kAbsent},
                                        {{1.0 + group, 0.5}, kAbsent}};
    }
  }

  DetectionCount Count(const SensorCalibration& sensor) const {
    DetectionCount count;
    CountDetections(build, sensor, GridOf(build, sensor.max_range_m), run, &count);
    return count;
  }

  VisitIndex VisitOf(GroupIndex group, Stamp stamp) {
    for (const VisitIndex v : data.visits.indices()) {
      if (data.visits[v].group == group) return v;
    }
    data.visits.push_back({group, stamp, stamp, {}});
    return data.visits.end_index() - 1;
  }

  MappingRun data;
  BuildRun run;
  BuildState build;
};

SensorCalibration Ahead(double max_range_m) {
  SensorCalibration sensor;
  sensor.max_range_m = max_range_m;
  sensor.max_bearing_rad = 1.0;
  return sensor;
}

TEST(CountDetections, CountsWhatStandsInView) {
  // Both are there from the first frame on, and each is missed once beside the other.
  const StandingRun standing({{0, 1}, {0}, {1}, {0, 1}});
  const DetectionCount count = standing.Count(Ahead(10.0));
  EXPECT_EQ(count.expected, 6.0);  // Not the one seen alone in the second and third frame.
  EXPECT_EQ(count.detected, 4.0);
}

TEST(CountDetections, ALandmarkCountsFromItsFirstVisitOn) {
  const DetectionCount count = StandingRun({{0, 1}, {0, 1}, {0, 1, 2}, {0, 1}}).Count(Ahead(10.0));
  EXPECT_EQ(count.expected, 10.0);
  EXPECT_EQ(count.detected, 9.0);
}

TEST(CountDetections, WhatIsOutOfRangeDoesNotCount) {
  const DetectionCount count = StandingRun({{0, 1, 2}, {0, 1}, {0, 1}}).Count(Ahead(2.5));
  EXPECT_EQ(count.expected, 6.0);
  EXPECT_EQ(count.detected, 6.0);
}

// Key frames are where something is seen, so that rates of what is there alone would be 1.
TEST(CountDetections, NothingIsLearntFromOneLandmarkAlone) {
  EXPECT_EQ(StandingRun({{0}, {0}, {0}}).Count(Ahead(10.0)).expected, 0.0);
}

TEST(EstimateDetection, FindsTheSensorOfTheSimulator) {
  for (const double truth : {0.4, 0.7, 0.9}) {
    double found = 0.0;
    constexpr int kSites = 5;
    for (std::uint64_t seed = 1; seed <= kSites; ++seed) {
      OpenWorldOptions options = testing::SmallWorld(seed);
      options.sensor.detection_probability = truth;
      options.mode_change_probability = 0.0;
      const SimulatedWorld world = testing::Simulate(options);
      const MappingRun run = testing::Arrange(world, world.runs[0].run);
      const BuildState build = MapSingleRun(run, world.groups.size(), {});
      const SensorCalibration sensor = EstimateDetection(build, {});
      found += sensor.detection_probability / kSites;
      // Quantiles of what was seen in it.
      EXPECT_NEAR(sensor.max_range_m / options.sensor.max_range_m, 0.97, 0.06);
      EXPECT_NEAR(sensor.max_bearing_rad / options.sensor.max_bearing_rad, 0.97, 0.06);
      EXPECT_LT(sensor.clutter_density_per_m2, 1e-3);
    }
    // Of some 1000 pairs at each site.
    EXPECT_NEAR(found, truth, 0.03) << truth;
    RecordProperty("found", std::to_string(found));
  }
}

TEST(EstimateDetection, OfTooFewSightingsChangesNothing) {
  StandingRun standing({{0, 1}});
  standing.build.runs.push_back(standing.run);
  standing.build.sensor = Ahead(7.0);
  const SensorCalibration sensor = EstimateDetection(standing.build, ModeOptions());
  EXPECT_EQ(sensor.max_range_m, 7.0);
  EXPECT_EQ(sensor.detection_probability, SensorCalibration().detection_probability);
}

}  // namespace
}  // namespace shiftmap
