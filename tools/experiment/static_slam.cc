// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/static_slam.h"

#include <algorithm>
#include <limits>

#include "mapper/frontend/usable_sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

StaticSlam::StaticSlam(StaticPolicy policy,
                       double gate_probability,
                       const AnonymousOptions& anonymous,
                       const Calibration& calibration,
                       const MapContent& prior)
    : policy_(policy),
      gate_(ChiSquareQuantile(gate_probability, 2)),
      anonymous_options_(anonymous),
      sensor_(calibration.sensor),
      state_(calibration) {
  std::vector<Eigen::Vector2d> positions;
  for (const LandmarkGroup& group : prior.groups) {
    for (const Mode& mode : group.modes) {
      landmarks_[group.signature].push_back(static_cast<int>(positions.size()));
      positions.push_back(mode.p_map_landmark);
    }
  }
  state_.AddKnown(positions, prior.covariance.Dense());
  for (const Mode& mode : prior.anonymous_landmarks) {
    const int known = state_.AddKnown({&mode.p_map_landmark, 1}, mode.cov_p_map_landmark);
    anonymous_.push_back({known, anonymous_options_.confirm_sightings, 0, mode.last_seen});
  }
}

void StaticSlam::BeginRun(const PoseWithCovariance& start, const Calibration& calibration) {
  sensor_ = calibration.sensor;
  state_.StartFrom(start, calibration);
}

void StaticSlam::Correct(const Scan& scan) {
  ++scan_;
  state_.Focus(sensor_.max_range_m + PlaceSlack(state_, sensor_.max_range_m));
  const UsableSightings usable = FindUsableSightings(scan, {});
  if (policy_ != StaticPolicy::kIgnore) {
    for (const int i : usable.named) Take(scan.observations[static_cast<std::size_t>(i)]);
  }
  UpdateAnonymous(scan, usable.anonymous, scan_, sensor_, anonymous_options_, &anonymous_, &state_);
}

void StaticSlam::Take(const Observation& observation) {
  std::vector<int>& landmarks = landmarks_[observation.signature];
  int nearest = -1;
  double least = std::numeric_limits<double>::infinity();
  for (const int landmark : landmarks) {
    state_.Activate(landmark);
    Eigen::Matrix2d S;
    const Innovation innovation = state_.Linearized({landmark, &observation}, &S);
    const double distance = SquaredMahalanobis(innovation.nu, S);
    if (distance >= least) continue;
    least = distance;
    nearest = landmark;
  }
  const bool gates = least <= gate_ || policy_ == StaticPolicy::kAlwaysUpdate;
  if (nearest < 0 || !gates) {
    landmarks.push_back(state_.Add(observation));
    return;
  }
  const SlamPair pair{nearest, &observation};
  state_.Update({&pair, 1});
}

}  // namespace shiftmap
