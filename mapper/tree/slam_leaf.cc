// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/slam_leaf.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace shiftmap {
namespace {

// Poses so far apart are told apart without asking the map. [-]
constexpr double kFarApart = 1.0;

}  // namespace

bool SlamMap::HasLandmarksOf(const SlamMap& other) const {
  const auto same_mode = [](const ModeLandmark& a, const ModeLandmark& b) {
    return a.landmark == b.landmark;
  };
  const auto same_modes = [&](const auto& a, const auto& b) {
    return std::equal(a.begin(), a.end(), b.begin(), b.end(), same_mode);
  };
  const auto same_landmark = [](const AnonymousLandmark& a, const AnonymousLandmark& b) {
    return a.landmark == b.landmark;
  };
  return state_.HasLandmarksOf(other.state_) &&
         std::equal(
             modes_.begin(), modes_.end(), other.modes_.begin(), other.modes_.end(), same_modes) &&
         std::equal(anonymous_.begin(),
                    anonymous_.end(),
                    other.anonymous_.begin(),
                    other.anonymous_.end(),
                    same_landmark);
}

void SlamMap::EraseMode(int group, int state) {
  std::vector<ModeLandmark>& modes = modes_[static_cast<std::size_t>(group)];
  modes.erase(modes.begin() + state - 1);
}

double SquaredDistance(const SlamMap& a, const SlamMap& b) {
  if (a.merging() == LeafMerging::kNone) return std::numeric_limits<double>::infinity();
  const PoseWithCovariance pose_a = a.Pose();
  const PoseWithCovariance pose_b = b.Pose();
  const double of_poses = SquaredMahalanobis(pose_a.T_map_vehicle,
                                             pose_b.T_map_vehicle,
                                             pose_a.cov_T_map_vehicle + pose_b.cov_T_map_vehicle);
  const bool comparable = a.HasLandmarksOf(b) && a.state().active() == b.state().active();
  if (!comparable || of_poses > kFarApart) return of_poses;
  return a.state().SquaredDistanceTo(b.state());
}

void Absorb(double log_share_into, double log_share_from, const SlamLeaf& from, SlamLeaf* into) {
  for (std::size_t i = 0; i < into->beliefs.size(); ++i) {
    GroupBelief& belief = into->beliefs[i];
    const GroupBelief& other = from.beliefs[i];
    if (belief.resolved == other.resolved && belief.resolved != GroupBelief::kUnresolved) continue;
    MixStates(log_share_into, log_share_from, other, &belief);
  }
  SlamMap& map = into->filter;
  if (map.merging() == LeafMerging::kMixture && map.HasLandmarksOf(from.filter)) {
    map.state().MixWith(from.filter.state(), std::exp(log_share_from));
  }
}

}  // namespace shiftmap
