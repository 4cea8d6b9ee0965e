// SPDX-License-Identifier: Apache-2.0
#include "mapper/run_maps/broken_motion.h"

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "mapper/state/sightings.h"

namespace shiftmap {
namespace {

// A sighting beyond it is at no mode. [m]
constexpr double kAtMode = 1.0;

constexpr int kLeastMovedPerStaying = 4;

// Of a landmark, and where it was.
struct SeenAt {
  int frame = 0;
  int mode = kUnassigned;
};

// Per motion how many landmarks are seen before and after it.
struct LandmarkCounts {
  std::vector<int> moved;
  std::vector<int> staying;
};

int ModeNear(const std::vector<BuildMode>& modes, const Eigen::Vector2d& position) {
  int nearest = kUnassigned;
  double least = kAtMode;
  for (std::size_t m = 0; m < modes.size(); ++m) {
    const double distance = (modes[m].p_map_landmark - position).norm();
    if (distance >= least) continue;
    least = distance;
    nearest = static_cast<int>(m);
  }
  return nearest;
}

LandmarkCounts CountLandmarks(const BuildState& build) {
  const BuildRun& run = build.runs.front();
  // Changes of the counts from motion to motion first.
  std::vector<int> moved(run.data->frames.size());
  std::vector<int> staying(run.data->frames.size());
  std::vector<SeenAt> last(build.modes.size());
  for (const MappingVisit& visit : run.data->visits) {
    const auto group = static_cast<std::size_t>(visit.group);
    const std::vector<Eigen::Vector2d> positions = VisitPositions(run, visit);
    for (std::size_t i = 0; i < positions.size(); ++i) {
      const int mode = ModeNear(build.modes[group], positions[i]);
      if (mode == kUnassigned) continue;
      const int frame = run.data->sightings[static_cast<std::size_t>(visit.sightings[i])].frame;
      if (last[group].mode != kUnassigned) {
        std::vector<int>& counts = last[group].mode == mode ? staying : moved;
        ++counts[static_cast<std::size_t>(last[group].frame)];
        --counts[static_cast<std::size_t>(frame)];
      }
      last[group] = {frame, mode};
    }
  }
  for (std::vector<int>* const counts : {&moved, &staying}) {
    for (std::size_t i = 1; i < counts->size(); ++i) (*counts)[i] += (*counts)[i - 1];
  }
  return {std::move(moved), std::move(staying)};
}

}  // namespace

std::optional<std::size_t> FindBrokenMotion(const BuildState& build) {
  const std::vector<KeyFrame>& frames = build.runs.front().data->frames;
  const LandmarkCounts landmarks = CountLandmarks(build);
  std::optional<std::size_t> best;
  const auto excess = [&](std::size_t i) { return landmarks.moved[i] - landmarks.staying[i]; };
  const auto seconds = [&](std::size_t i) { return frames[i + 1].stamp - frames[i].stamp; };
  for (std::size_t i = 0; i + 1 < frames.size(); ++i) {
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
