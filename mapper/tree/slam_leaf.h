// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "localizer/hypothesis/leaf.h"
#include "mapper/frontend/slam_state.h"
#include "mapper/tree/anonymous_update.h"
#include "mapper/tree/tree_options.h"

namespace shiftmap {

/// The filter of a leaf of the tree engine: EKF-SLAM with which of its landmarks are modes of which
/// groups. All modes are in the map of every leaf that found them, whether the leaf takes them for
/// active or not, T-IV V-A.
class SlamMap {
 public:
  static constexpr int kNoLandmark = -1;

  /// A mode as this leaf knows it.
  struct ModeLandmark {
    int landmark = kNoLandmark;  ///< In state(); kNoLandmark: this leaf has not found it.
    int sightings = 0;           ///< That corrected it.
  };

  SlamMap(const Calibration& calibration, SlamState::Errors errors, LeafMerging merging)
      : state_(calibration, errors), merging_(merging) {}

  PoseWithCovariance Pose() const { return state_.Pose(); }
  SlamState& state() { return state_; }
  const SlamState& state() const { return state_; }
  LeafMerging merging() const { return merging_; }

  /// Landmark of a state >= 1 of a group.
  const ModeLandmark& mode(int group, int state) const {
    return modes_[static_cast<std::size_t>(group)][static_cast<std::size_t>(state) - 1];
  }
  ModeLandmark& mode(int group, int state) {
    return modes_[static_cast<std::size_t>(group)][static_cast<std::size_t>(state) - 1];
  }
  void AddGroup() { modes_.emplace_back(); }
  void AddMode(int group) { modes_[static_cast<std::size_t>(group)].emplace_back(); }

  /// Takes a mode out of the list of its group; later ones move up.
  void EraseMode(int group, int state);

  /// True if both know the same landmarks under the same ids.
  bool HasLandmarksOf(const SlamMap& other) const;

  std::vector<AnonymousLandmark>& anonymous() { return anonymous_; }
  const std::vector<AnonymousLandmark>& anonymous() const { return anonymous_; }

 private:
  SlamState state_;
  LeafMerging merging_;
  std::vector<std::vector<ModeLandmark>> modes_;  // By group, then state - 1.
  std::vector<AnonymousLandmark> anonymous_;
};

/// T-IV (26), of pose and map; of the poses alone where the maps are not of the same landmarks.
/// Infinite where leaves are not to merge.
double SquaredDistance(const SlamMap& a, const SlamMap& b);

using SlamLeaf = BasicLeaf<SlamMap>;

/// Beliefs mix. The heavier filter stays, or becomes the mixture of both where they have the same
/// landmarks.
void Absorb(double log_share_into, double log_share_from, const SlamLeaf& from, SlamLeaf* into);

}  // namespace shiftmap
