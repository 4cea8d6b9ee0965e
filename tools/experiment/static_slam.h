// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <vector>

#include "mapper/frontend/slam_state.h"
#include "mapper/tree/tree_slam.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// What EKF-SLAM that believes in a static world does with signatures.
enum class StaticPolicy {
  /// A signature is its landmark, wherever it is seen: T-IV IX-E, "static SLAM".
  kAlwaysUpdate,
  /// What gates with no landmark of its signature is another one of the same signature. On a map
  /// that has forgotten where landmarks stood before: T-IV IX-F, perfect memory decay.
  kAddUngated,
  /// Signatures are not used: T-IV IX-F, perfect outlier rejection of landmarks that move.
  kIgnore,
};

/// One EKF, T-IV (27)-(29), as a comparator of TreeSlam: the same state, front end, gates and
/// noise.
class StaticSlam {
 public:
  /// On the map of a TreeSlam's likeliest leaf: every mode of it is a landmark.
  StaticSlam(StaticPolicy policy, const TreeSlamOptions& options, const TreeSlam& mapped);

  /// Takes a landmark of a signature out of the map, the number `i` of landmarks().
  void Forget(const Signature& signature, std::size_t i);

  void BeginRun(const PoseWithCovariance& start, const Calibration& calibration);
  SlamState& state() { return state_; }
  PoseWithCovariance Pose() const { return state_.Pose(); }
  void Correct(const Scan& scan);

  /// Landmarks of a signature.
  const std::map<Signature, std::vector<int>>& landmarks() const { return landmarks_; }

 private:
  void Take(const Observation& observation);

  StaticPolicy policy_;
  double gate_;
  AnonymousOptions anonymous_options_;
  SensorCalibration sensor_;
  SlamState state_;
  std::map<Signature, std::vector<int>> landmarks_;
  std::vector<AnonymousLandmark> anonymous_;
  int scan_ = 0;
};

}  // namespace shiftmap
