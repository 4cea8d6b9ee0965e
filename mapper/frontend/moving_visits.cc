// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/moving_visits.h"

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <iterator>
#include <map>

#include "mapper/frontend/frame_motions.h"
#include "mapper/frontend/pair_calibration.h"

namespace shiftmap {
namespace {

constexpr double kLeastWay = 2.0;     // Of a landmark in the vehicle frame. [m]
constexpr double kLongest = 5.0;      // That odometry is asked over. [s]
constexpr double kMovingShare = 0.5;  // Of the way that a landmark is off, if it moves.
constexpr int kLeastMoves = 8;        // Of a visit.
constexpr int kMovesPerStanding = 2;  // At least.

// What two sightings of a visit say: the landmark stands, or it moves.
struct Vote {
  VisitIndex visit;
  std::int64_t second = 0;  // Of the later sighting.
  bool moves = false;
};

struct Count {
  int stand = 0;
  int move = 0;
};

std::vector<Vote> VotesOf(const MappingRun& run, const OdometryCalibration& odometry) {
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(run, odometry);
  std::vector<Vote> votes;
  for (const VisitIndex v : run.visits.indices()) {
    const std::vector<SightingIndex>& sightings = run.visits[v].sightings;
    SightingIndex anchor = sightings.front();
    for (const SightingIndex s : sightings) {
      const Sighting& before = run.sightings[anchor];
      const Sighting& now = run.sightings[s];
      const Stamp stamp = run.frames[now.frame].stamp;
      if (ToSeconds(stamp - run.frames[before.frame].stamp) > kLongest) {
        anchor = s;
        continue;
      }
      const Eigen::Vector2d p = before.observation.PositionInVehicle();
      const Eigen::Vector2d expected = poses[now.frame].Inverse() * (poses[before.frame] * p);
      const double way = (expected - p).norm();
      if (!(way >= kLeastWay)) continue;
      const double off = (now.observation.PositionInVehicle() - expected).norm();
      votes.push_back(
          {v, stamp.time_since_epoch() / std::chrono::seconds(1), off > kMovingShare * way});
      anchor = s;
    }
  }
  return votes;
}

std::vector<VisitIndex> MovingBy(const OdometryCalibration& odometry, const MappingRun& run) {
  const std::vector<Vote> votes = VotesOf(run, odometry);
  std::map<std::int64_t, Count> meanwhile;
  for (const Vote& vote : votes) {
    Count& count = meanwhile[vote.second];
    ++(vote.moves ? count.move : count.stand);
  }
  std::map<VisitIndex, Count> by_visit;
  for (const Vote& vote : votes) {
    Count& count = by_visit[vote.visit];
    const Count& all = meanwhile[vote.second];
    if (!vote.moves) ++count.stand;
    if (vote.moves && all.stand >= all.move) ++count.move;
  }
  std::vector<VisitIndex> moving;
  for (const auto& [visit, count] : by_visit) {
    if (count.move >= kLeastMoves && count.move >= kMovesPerStanding * count.stand) {
      moving.push_back(visit);
    }
  }
  return moving;
}

}  // namespace

std::vector<VisitIndex> FindMovingVisits(const MappingRun& run) {
  if (run.odometry.empty() || run.frames.empty()) return {};
  const std::vector<VisitIndex> found = MovingBy({}, run);
  if (found.empty()) return {};
  // By odometry as the other landmarks have it: by another scale of it, what stands in the middle
  // of a circle moves.
  MappingRun others = run;
  for (const VisitIndex v : found) others.visits[v].sightings.clear();
  const std::vector<VisitIndex> still = MovingBy(CalibrateFromPairs(others, {}).odometry, run);
  std::vector<VisitIndex> moving;
  std::set_intersection(
      found.begin(), found.end(), still.begin(), still.end(), std::back_inserter(moving));
  return moving;
}

}  // namespace shiftmap
