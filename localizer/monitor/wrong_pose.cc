// SPDX-License-Identifier: Apache-2.0
#include "localizer/monitor/wrong_pose.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <limits>
#include <map>
#include <vector>

#include "localizer/initialization/start_pose.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/main_mode.h"

namespace shiftmap {
namespace {

constexpr double kWindowsS[] = {3.0, 1.5, 0.75};

// Landmarks that must have turned for the pose to have gone wrong in view of them.
constexpr int kMinTurned = 2;

// Seeing nothing counts where one would have failed to see the landmark with e⁻³. [nat]
constexpr double kMissed = 3.0;

// Landmarks that the present pose may miss more if it has been proven lately.
constexpr int kMissedMore = 2;
constexpr Duration kLately = std::chrono::seconds(30);

// Landmarks that another pose must explain more, by a few seconds of sightings: two fit some pose
// or other, always.
constexpr int kMinGain = 3;

// A landmark of fewer sightings counts neither as standing nor as adrift. Of the landmarks adrift
// one may be carried, so that more are needed.
constexpr int kMinSightings = 3;
constexpr int kMinAdrift = 2;

// Landmarks that one who is at `pose` after the last scan would have seen and did not, by where
// they were most likely when the map was built.
int CountMissed(const Se2& pose,
                const std::vector<WindowScan>& window,
                const MapSnapshot& snapshot,
                FieldOfView field_of_view) {
  const SensorCalibration& sensor = snapshot.calibration().sensor;
  std::vector<double> missed(snapshot.groups().size());
  Se2 T_map_vehicle = pose;
  for (std::size_t i = window.size(); i-- > 0;) {
    const std::vector<Observation>& seen = window[i].scan.observations;
    const Se2 T_vehicle_map = T_map_vehicle.Inverse();
    field_of_view.Look(&window[i].lidar);
    for (std::size_t group = 0; !seen.empty() && group < missed.size(); ++group) {
      const LandmarkGroup& landmark = snapshot.groups()[group];
      const Mode& mode = landmark.modes[MainMode(landmark)];
      if (!field_of_view.WellInView(T_vehicle_map * mode.p_map_landmark)) continue;
      missed[group] -= std::log1p(-sensor.detection_probability);
    }
    for (const Observation& observation : seen) {
      const int group = snapshot.GroupIndex(observation.signature);
      if (group >= 0) missed[static_cast<std::size_t>(group)] = -1e9;
    }
    T_map_vehicle = T_map_vehicle * window[i].motion.increment.T_begin_end.Inverse();
  }
  return static_cast<int>(
      std::count_if(missed.begin(), missed.end(), [](double m) { return m > kMissed; }));
}

}  // namespace

bool ContradictsOdometry(const std::vector<WindowScan>& window,
                         const MapSnapshot& snapshot,
                         int min_adrift) {
  struct Sightings {
    int all = 0;
    int at_one_place = 0;
  };
  std::map<int, Sightings> by_group;
  for (const SightingCluster& cluster :
       ClusterSightings(window, snapshot, std::numeric_limits<int>::max())) {
    Sightings& sightings = by_group[cluster.group];
    sightings.all += cluster.count;
    sightings.at_one_place = std::max(sightings.at_one_place, cluster.count);
  }
  int standing = 0;
  int adrift = 0;
  for (const auto& [group, sightings] : by_group) {
    if (sightings.all < kMinSightings) continue;
    ++(2 * sightings.at_one_place < sightings.all ? adrift : standing);
  }
  return adrift >= min_adrift && adrift > standing;
}

std::optional<PoseFault> FindWrongPose(const PresentPose& present,
                                       const MapSnapshot& snapshot,
                                       const FieldOfView& field_of_view,
                                       const GlobalStartOptions& options) {
  for (const double window_s : kWindowsS) {
    const Stamp since = present.stamp - FromSeconds(window_s);
    const PoseSupport support = present.health.Support(since, -1);
    // Then nothing fails in the shorter ones either.
    if (support.failing == 0) return std::nullopt;
    if (support.failing < support.agreeing) continue;
    const std::vector<WindowScan> window = present.recent.Since(since);
    if (window.empty()) continue;
    const bool nothing_agrees = window_s == kWindowsS[0] && support.agreeing == 0;
    if (ContradictsOdometry(window, snapshot, nothing_agrees ? 1 : kMinAdrift)) {
      return PoseFault{since, std::nullopt, true};
    }
    if (!support.Doubts()) continue;
    // Landmarks that never agreed may be all that is in view: then it takes the longest.
    if (support.turned < kMinTurned && window_s < kWindowsS[0]) continue;
    const auto other = FindGlobalStart(window, snapshot, options);
    if (!other || other->explained < support.agreeing + kMinGain) continue;
    const PoseWithCovariance there = PoseAtEnd(*other, window);
    if (!Apart(there, present.pose)) continue;
    const auto missed_at = [&](const PoseWithCovariance& at) {
      return CountMissed(at.T_map_vehicle, window, snapshot, field_of_view);
    };
    // What had agreed fails now: the pose has gone wrong.
    if (support.turned >= kMinTurned) return PoseFault{since};
    const int proof = present.health.CountAtModes(present.stamp - kLately).yes;
    const bool proven = proof >= other->explained;
    if (missed_at(there) + (proven ? kMissedMore : 0) < missed_at(present.pose)) {
      return PoseFault{since, there};
    }
  }
  return std::nullopt;
}

std::optional<PoseWithCovariance> FindOtherStart(const PresentPose& present,
                                                 Stamp started,
                                                 const MapSnapshot& snapshot,
                                                 const GlobalStartOptions& options) {
  const std::optional<Stamp> begin = present.recent.Begin();
  if (!begin) return std::nullopt;
  const HealthMonitor::AtModes at_modes = present.health.CountAtModes(*begin);
  const int here = at_modes.yes + (*begin > started ? at_modes.of_start : 0);
  if (at_modes.no <= here) return std::nullopt;
  const std::vector<WindowScan> window = present.recent.Since(*begin);
  const auto other = FindGlobalStart(window, snapshot, options);
  if (!other || other->explained <= here) return std::nullopt;
  const PoseWithCovariance there = PoseAtEnd(*other, window);
  if (!Apart(there, present.pose)) return std::nullopt;
  return there;
}

}  // namespace shiftmap
