// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/incremental/incremental_options.h"

#include <cmath>

namespace shiftmap {
namespace {

constexpr double kMaxWindowS = 1e9;  // Decades; stamps hold 292 years.

}  // namespace

Status IncrementalOptions::Validate() const {
  const auto within = [](double value) { return value > 0.0 && value < 1.0; };
  SHIFTMAP_RETURN_IF_ERROR(selector.Validate());
  if (!(window_s > 0.0) || (window_s > kMaxWindowS && std::isfinite(window_s))) {
    return InvalidArgument("window_s: {}, expected > 0 and at most 1e9, or infinite", window_s);
  }
  if (!within(gate_probability)) {
    return InvalidArgument("gate_probability: {}, expected in (0, 1)", gate_probability);
  }
  if (min_sightings < 1) {
    return InvalidArgument("min_sightings: {}, expected 1 or more", min_sightings);
  }
  if (!(merge_probability >= 0.0 && merge_probability < 1.0)) {
    return InvalidArgument("merge_probability: {}, expected in [0, 1)", merge_probability);
  }
  if (!(position_floor_m >= 0.0)) {
    return InvalidArgument("position_floor_m: {}, expected 0 or more", position_floor_m);
  }
  if (!within(change_probability)) {
    return InvalidArgument("change_probability: {}, expected in (0, 1)", change_probability);
  }
  if (!within(sensor.detection_probability)) {
    return InvalidArgument("detection_probability: {}, expected in (0, 1)",
                           sensor.detection_probability);
  }
  if (!(smoother.calibration_sd.array() > 0.0).all() || !(smoother.loss_scale > 0.0)) {
    return InvalidArgument("calibration_sd and loss_scale: expected > 0");
  }
  if (!(smoother.relinearize_threshold > 0.0) || smoother.max_iterations < 1) {
    return InvalidArgument("relinearize_threshold and max_iterations: expected > 0");
  }
  if (max_alternations < 1) {
    return InvalidArgument("max_alternations: {}, expected 1 or more", max_alternations);
  }
  return OkStatus();
}

}  // namespace shiftmap
