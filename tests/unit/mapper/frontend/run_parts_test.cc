// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/run_parts.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <vector>

#include "mapper/frontend/frame_motions.h"
#include "tests/support/geometry_matchers.h"
#include "tests/unit/mapper/mapper_test_util.h"

namespace shiftmap {
namespace {

class RunPartsTest : public ::testing::Test {
 protected:
  const SimulatedWorld world_ = testing::StaticWorld(3);
  const MappingRun run_ = testing::Arrange(world_, world_.runs[0].run);
};

TEST_F(RunPartsTest, TogetherHaveWhatTheRunHas) {
  for (const double part_s : {7.0, 30.0, 1e6}) {
    SCOPED_TRACE(part_s);
    FrameIndex frames;
    SightingIndex sightings;
    const RunParts parts(run_, part_s);
    for (std::size_t k = 0; k < parts.size(); ++k) {
      const MappingRun& part = parts.At(k);
      for (const KeyFrame& frame : part.frames) {
        EXPECT_EQ(frame.stamp, run_.frames[frames].stamp);
        EXPECT_EQ(frame.sighting_count, run_.frames[frames].sighting_count);
        ++frames;
      }
      std::size_t in_visits = 0;
      for (const VisitIndex v : part.visits.indices()) {
        for (const SightingIndex s : part.visits[v].sightings) {
          const Sighting& sighting = part.sightings[s];
          const Sighting& before = run_.sightings[sightings + s.value()];
          EXPECT_EQ(sighting.visit, v);
          EXPECT_EQ(sighting.observation.z, before.observation.z);
          EXPECT_EQ(part.visits[v].group, run_.visits[before.visit].group);
          const KeyFrame& frame = part.frames[sighting.frame];
          EXPECT_LE(part.visits[v].begin, frame.stamp);
          EXPECT_GE(part.visits[v].end, frame.stamp);
          EXPECT_GE(s, frame.first_sighting);
          EXPECT_LT(s, frame.first_sighting + frame.sighting_count);
          ++in_visits;
        }
      }
      EXPECT_EQ(in_visits, part.sightings.size());
      sightings = sightings + part.sightings.end_index().value();
    }
    EXPECT_EQ(frames, run_.frames.end_index());
    EXPECT_EQ(sightings, run_.sightings.end_index());
  }
}

TEST_F(RunPartsTest, MoveAsTheRunDoes) {
  OdometryCalibration calibration;
  calibration.lag_s = 0.4;
  const FrameMotions whole = IntegrateMotions(run_, calibration);
  FrameIndex at;
  const RunParts parts(run_, 20.0);
  for (std::size_t k = 0; k < parts.size(); ++k) {
    for (const IntegratedMotion& motion :
         IntegrateMotions(parts.At(k), calibration).between_frames) {
      EXPECT_THAT(motion.T_begin_end,
                  testing::IsNearPose(whole.between_frames[at].T_begin_end, 1e-9));
      ++at;
    }
    ++at;  // From the last of the part to the first of the next.
  }
}

TEST_F(RunPartsTest, TakeAboutTheTimeTheyAreTold) {
  for (const double part_s : {10.0, 25.0}) {
    const RunParts parts(run_, part_s);
    for (std::size_t k = 0; k < parts.size(); ++k) {
      EXPECT_LT(DurationOf(parts.At(k)), 1.5 * part_s);
    }
  }
  EXPECT_EQ(RunParts(run_, 2.0 * DurationOf(run_)).size(), 1u);
}

TEST_F(RunPartsTest, GoAcrossNoBrokenMotion) {
  const FrameIndex broken(run_.frames.size() / 3);
  const RunParts parts(run_, 2.0 * DurationOf(run_), {broken});
  ASSERT_EQ(parts.size(), 2u);
  EXPECT_EQ(parts.At(0).frames.end_index(), broken + 1);
  EXPECT_EQ(parts.At(1).frames.front().stamp, run_.frames[broken + 1].stamp);
}

// Where odometry is right, one part that is placed tells where all of the run is.
TEST_F(RunPartsTest, PosesGoOnByOdometry) {
  const FrameMotions motions = IntegrateMotions(run_, {});
  const std::vector<Se2> reckoned = DeadReckon(motions);
  const Se2 T_map_run(3.0, -2.0, 1.0);
  for (const std::size_t placed : {0u, 2u, 4u}) {
    RunParts parts(run_, DurationOf(run_) / 5.0);
    ASSERT_EQ(parts.size(), 5u);
    std::size_t begin = 0;
    for (std::size_t k = 0; k < placed; ++k) begin += parts.At(k).frames.size();
    std::vector<Se2> poses;
    for (std::size_t i = 0; i < parts.At(placed).frames.size(); ++i) {
      poses.push_back(T_map_run * reckoned[begin + i]);
    }
    parts.Place(placed, poses);
    const std::vector<Se2> all = parts.Poses(motions);
    ASSERT_EQ(all.size(), reckoned.size());
    for (std::size_t i = 0; i < all.size(); ++i) {
      EXPECT_THAT(all[i], testing::IsNearPose(T_map_run * reckoned[i], 1e-9));
    }
  }
}

}  // namespace
}  // namespace shiftmap
