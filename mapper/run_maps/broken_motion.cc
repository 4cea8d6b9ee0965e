// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/broken_motion.h"

#include <Eigen/Core>
#include <numeric>
#include <vector>

#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// A sighting beyond it is at no mode. [m]
constexpr double kAtMode = 1.0;

// Landmarks that moved, for each that stayed.
constexpr int kLeastMovedPerStaying = 4;

// Of a landmark, and where it was.
struct SeenAt {
  FrameIndex frame;
  OptionalMode mode;
};

// Per motion how many landmarks are seen before and after it.
struct LandmarkCounts {
  IndexedVector<FrameIndex, int> moved;
  IndexedVector<FrameIndex, int> staying;
};

OptionalMode ModeNear(const GroupModes& modes, const Eigen::Vector2d& position) {
  OptionalMode nearest;
  double least = kAtMode;
  for (const GroupModeIndex mode : modes.indices()) {
    const double distance = (modes[mode].p_map_landmark - position).norm();
    if (distance >= least) continue;
    least = distance;
    nearest = mode;
  }
  return nearest;
}

LandmarkCounts CountLandmarks(const BuildState& build) {
  const BuildRun& run = build.runs.front();
  // Changes of the counts from motion to motion first.
  LandmarkCounts landmarks;
  landmarks.moved.resize(run.data->frames.size());
  landmarks.staying.resize(run.data->frames.size());
  IndexedVector<GroupIndex, SeenAt> last(build.modes.size());
  for (const MappingVisit& visit : run.data->visits) {
    const std::vector<Eigen::Vector2d> positions = VisitPositions(run, visit);
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const OptionalMode mode = ModeNear(build.modes[visit.group], positions[i]);
      if (!mode) continue;
      const FrameIndex frame = run.data->sightings[visit.sightings[i]].frame;
      SeenAt& before = last[visit.group];
      if (before.mode) {
        auto& counts = before.mode == mode ? landmarks.staying : landmarks.moved;
        ++counts[before.frame];
        --counts[frame];
      }
      before = {frame, mode};
    }
  }
  for (auto* const counts : {&landmarks.moved, &landmarks.staying}) {
    std::partial_sum(counts->begin(), counts->end(), counts->begin());
  }
  return landmarks;
}

}  // namespace

std::optional<FrameIndex> FindBrokenMotion(const BuildState& build) {
  const auto& frames = build.runs.front().data->frames;
  const LandmarkCounts landmarks = CountLandmarks(build);
  std::optional<FrameIndex> best;
  const auto excess = [&](FrameIndex i) { return landmarks.moved[i] - landmarks.staying[i]; };
  const auto seconds = [&](FrameIndex i) { return frames[i + 1].stamp - frames[i].stamp; };
  for (FrameIndex i; i + 1 < frames.end_index(); ++i) {
    if (landmarks.moved[i] < kLeastMoved ||
        landmarks.moved[i] < kLeastMovedPerStaying * landmarks.staying[i]) {
      continue;
    }
    // Of equal ones the longest.
    if (!best || excess(i) > excess(*best) ||
        (excess(i) == excess(*best) && seconds(i) > seconds(*best))) {
      best = i;
    }
  }
  return best;
}

}  // namespace shiftmap
