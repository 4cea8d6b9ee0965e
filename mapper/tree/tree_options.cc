// SPDX-License-Identifier: Apache-2.0
#include "mapper/tree/tree_options.h"

namespace shiftmap {

Status TreeSlamOptions::Validate() const {
  const auto probability = [](double value) { return value > 0.0 && value < 1.0; };
  if (!(alpha > 0.0 && alpha < 0.5)) {
    return InvalidArgument("alpha: {}, expected within (0, 0.5)", alpha);
  }
  if (max_leaves < 1) return InvalidArgument("max_leaves: {}, expected 1 or more", max_leaves);
  if (!probability(gate_probability)) {
    return InvalidArgument("gate_probability: {}, expected within (0, 1)", gate_probability);
  }
  if (!(probability(fov_enter) && probability(fov_leave) && fov_leave < fov_enter)) {
    return InvalidArgument("fov_leave: {}, expected within (0, fov_enter), fov_enter: {}, below 1",
                           fov_leave,
                           fov_enter);
  }
  if (!(visit_gap_s > 0.0)) return InvalidArgument("visit_gap_s: {}, expected > 0", visit_gap_s);
  if (!(leave_rate_per_s >= 0.0)) {
    return InvalidArgument("leave_rate_per_s: {}, expected 0 or more", leave_rate_per_s);
  }
  for (const double value :
       {anonymous_landmarks.gate_probability, anonymous_landmarks.isolation_probability}) {
    if (probability(value)) continue;
    return InvalidArgument("anonymous_landmarks: probability {}, expected within (0, 1)", value);
  }
  if (min_sightings < 1 || anonymous_landmarks.confirm_sightings < 1 ||
      anonymous_landmarks.confirm_within_scans < 1) {
    return InvalidArgument("min_sightings, confirm_sightings, confirm_within_scans: expected > 0");
  }
  if (!(position_floor_m >= 0.0)) {
    return InvalidArgument("position_floor_m: {}, expected 0 or more", position_floor_m);
  }
  return OkStatus();
}

}  // namespace shiftmap
