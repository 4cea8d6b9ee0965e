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

std::vector<MappingRun> AllParts(const MappingRun& run, double part_s) {
  const std::vector<int> starts = PartStarts(run, part_s);
  std::vector<MappingRun> parts;
  for (std::size_t k = 0; k < starts.size(); ++k) {
    const auto frames = static_cast<int>(run.frames.size());
    parts.push_back(PartOf(run, starts[k], k + 1 < starts.size() ? starts[k + 1] : frames));
  }
  return parts;
}

class RunParts : public ::testing::Test {
 protected:
  const SimulatedWorld world_ = testing::StaticWorld(3);
  const MappingRun run_ = testing::Arrange(world_, world_.runs[0].run);
};

TEST_F(RunParts, TogetherHaveWhatTheRunHas) {
  for (const double part_s : {7.0, 30.0, 1e6}) {
    SCOPED_TRACE(part_s);
    std::size_t frames = 0;
    std::size_t sightings = 0;
    for (const MappingRun& part : AllParts(run_, part_s)) {
      for (const KeyFrame& frame : part.frames) {
        EXPECT_EQ(frame.stamp, run_.frames[frames].stamp);
        EXPECT_EQ(frame.sighting_count, run_.frames[frames].sighting_count);
        ++frames;
      }
      std::size_t in_visits = 0;
      for (std::size_t v = 0; v < part.visits.size(); ++v) {
        for (const int s : part.visits[v].sightings) {
          const Sighting& sighting = part.sightings[static_cast<std::size_t>(s)];
          const Sighting& before = run_.sightings[sightings + static_cast<std::size_t>(s)];
          EXPECT_EQ(sighting.visit, static_cast<int>(v));
          EXPECT_EQ(sighting.observation.z, before.observation.z);
          EXPECT_EQ(part.visits[v].group,
                    run_.visits[static_cast<std::size_t>(before.visit)].group);
          const KeyFrame& frame = part.frames[static_cast<std::size_t>(sighting.frame)];
          EXPECT_LE(part.visits[v].begin, frame.stamp);
          EXPECT_GE(part.visits[v].end, frame.stamp);
          EXPECT_GE(s, frame.first_sighting);
          EXPECT_LT(s, frame.first_sighting + frame.sighting_count);
          ++in_visits;
        }
      }
      EXPECT_EQ(in_visits, part.sightings.size());
      sightings += part.sightings.size();
    }
    EXPECT_EQ(frames, run_.frames.size());
    EXPECT_EQ(sightings, run_.sightings.size());
  }
}

TEST_F(RunParts, MoveAsTheRunDoes) {
  OdometryCalibration calibration;
  calibration.lag_s = 0.4;
  const FrameMotions whole = IntegrateMotions(run_, calibration);
  std::size_t at = 0;
  for (const MappingRun& part : AllParts(run_, 20.0)) {
    for (const IntegratedMotion& motion : IntegrateMotions(part, calibration).between_frames) {
      EXPECT_THAT(motion.T_begin_end,
                  testing::IsNearPose(whole.between_frames[at].T_begin_end, 1e-9));
      ++at;
    }
    ++at;  // From the last of the part to the first of the next.
  }
}

TEST_F(RunParts, TakeAboutTheTimeTheyAreTold) {
  const double duration = ToSeconds(run_.frames.back().stamp - run_.frames.front().stamp);
  for (const double part_s : {10.0, 25.0}) {
    for (const MappingRun& part : AllParts(run_, part_s)) {
      EXPECT_LT(ToSeconds(part.frames.back().stamp - part.frames.front().stamp), 1.5 * part_s);
    }
  }
  EXPECT_EQ(PartStarts(run_, 2.0 * duration), std::vector<int>{0});
}

}  // namespace
}  // namespace shiftmap
