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

std::vector<Vote> VotesOf(const MappingRun& run,
                          const OdometryCalibration& odometry,
                          const MovingVisitOptions& options) {
  const IndexedVector<FrameIndex, Se2> poses = DeadReckon(run, odometry);
  std::vector<Vote> votes;
  for (const VisitIndex v : run.visits.indices()) {
    const std::vector<SightingIndex>& sightings = run.visits[v].sightings;
    SightingIndex anchor = sightings.front();
    for (const SightingIndex s : sightings) {
      const Sighting& before = run.sightings[anchor];
      const Sighting& now = run.sightings[s];
      const Stamp stamp = run.frames[now.frame].stamp;
      if (ToSeconds(stamp - run.frames[before.frame].stamp) > options.max_time_s) {
        anchor = s;
        continue;
      }
      const Eigen::Vector2d p = before.observation.PositionInVehicle();
      const Eigen::Vector2d expected = poses[now.frame].Inverse() * (poses[before.frame] * p);
      const double way = (expected - p).norm();
      if (!(way >= options.min_way_m)) continue;
      const double off = (now.observation.PositionInVehicle() - expected).norm();
      votes.push_back(
          {v, stamp.time_since_epoch() / std::chrono::seconds(1), off > options.moved_share * way});
      anchor = s;
    }
  }
  return votes;
}

std::vector<VisitIndex> MovingBy(const OdometryCalibration& odometry,
                                 const MappingRun& run,
                                 const MovingVisitOptions& options) {
  const std::vector<Vote> votes = VotesOf(run, odometry, options);
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
    if (count.move >= options.min_moves &&
        count.move >= options.min_moves_per_standing * count.stand) {
      moving.push_back(visit);
    }
  }
  return moving;
}

}  // namespace

std::vector<VisitIndex> FindMovingVisits(const MappingRun& run, const MovingVisitOptions& options) {
  if (run.odometry.empty() || run.frames.empty()) return {};
  const std::vector<VisitIndex> found = MovingBy({}, run, options);
  if (found.empty()) return {};
  // By odometry as the other landmarks have it: by another scale of it, what stands in the middle
  // of a circle moves.
  MappingRun others = run;
  for (const VisitIndex v : found) others.visits[v].sightings.clear();
  const std::vector<VisitIndex> still =
      MovingBy(CalibrateFromPairs(others, {}).odometry, run, options);
  std::vector<VisitIndex> moving;
  std::set_intersection(
      found.begin(), found.end(), still.begin(), still.end(), std::back_inserter(moving));
  return moving;
}

}  // namespace shiftmap
