// SPDX-License-Identifier: Apache-2.0
#include "mapper/frontend/gated_landmarks.h"

#include "mapstore/geometry/covariance.h"

namespace shiftmap {
namespace {

constexpr double kGateProbability = 0.999;  // Of sightings of the landmark that pass.

// A landmark that only its first sighting supports may have been misread; after this many misses in
// a row its place is given to the newest sighting.
constexpr int kMissesToReplace = 5;

}  // namespace

GatedLandmarks::GatedLandmarks() : gate_(ChiSquareQuantile(kGateProbability, 2)) {}

void GatedLandmarks::Observe(int number, const Observation& observation, SlamState* state) {
  const auto [entry, added] = landmarks_.try_emplace(number);
  Landmark& landmark = entry->second;
  if (added) {
    landmark.id = state->Add(observation);
    return;
  }
  state->Activate(landmark.id);
  const SlamPair pair{landmark.id, &observation};
  Eigen::Matrix2d S;
  const Innovation innovation = state->Linearized(pair, &S);
  if (SquaredMahalanobis(innovation.nu, S) <= gate_) {
    state->Update({&pair, 1});
    ++landmark.updates;
    landmark.misses = 0;
  } else if (++landmark.misses >= kMissesToReplace && landmark.updates == 0) {
    state->Place(landmark.id, observation);
    landmark.misses = 0;
  }
}

}  // namespace shiftmap
