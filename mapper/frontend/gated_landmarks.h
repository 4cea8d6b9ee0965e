// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unordered_map>

#include "mapper/frontend/slam_state.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// Landmarks of a SlamState that are known by a number, one position each. An observation beyond
/// the gate of its landmark is skipped: the landmark moved, or was misread.
class GatedLandmarks {
 public:
  GatedLandmarks();

  /// Corrects `state` by an observation of landmark `number`, or adds the landmark.
  void Observe(int number, const Observation& observation, SlamState* state);

 private:
  struct Landmark {
    int id = 0;  // In the state.
    int updates = 0;
    int misses = 0;
  };

  double gate_;
  std::unordered_map<int, Landmark> landmarks_;
};

}  // namespace shiftmap
