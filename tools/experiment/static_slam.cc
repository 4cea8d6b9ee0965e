// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/static_slam.h"

#include <algorithm>
#include <limits>

#include "mapper/frontend/usable_sightings.h"
#include "mapstore/geometry/covariance.h"

namespace shiftmap {

StaticSlam::StaticSlam(StaticPolicy policy, const TreeSlamOptions& options, const TreeSlam& mapped)
    : policy_(policy),
      gate_(ChiSquareQuantile(options.gate_probability, 2)),
      anonymous_options_(options.anonymous_landmarks),
      state_(mapped.best().filter.state()),
      anonymous_(mapped.best().filter.anonymous()) {
  std::erase_if(anonymous_, [&](const AnonymousLandmark& landmark) {
    const bool confirmed = landmark.sightings >= anonymous_options_.confirm_sightings;
    if (!confirmed) state_.Remove(landmark.landmark);
    return !confirmed;
  });
  const SlamMap& map = mapped.best().filter;
  for (std::size_t g = 0; g < mapped.groups().size(); ++g) {
    const LandmarkGroup& group = mapped.groups()[g];
    for (std::size_t k = 0; k < group.modes.size(); ++k) {
      const int landmark = map.mode(static_cast<int>(g), static_cast<int>(k) + 1).landmark;
      if (landmark != SlamMap::kNoLandmark) landmarks_[group.signature].push_back(landmark);
    }
  }
}

void StaticSlam::Forget(const Signature& signature, std::size_t i) {
  std::vector<int>& landmarks = landmarks_[signature];
  state_.Remove(landmarks[i]);
  landmarks.erase(landmarks.begin() + static_cast<std::ptrdiff_t>(i));
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
