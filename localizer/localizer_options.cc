// SPDX-License-Identifier: Apache-2.0
#include "localizer/localizer_options.h"

#include "localizer/initialization/start_pose.h"
#include "mapstore/core/day.h"

namespace shiftmap {
namespace {

Status CheckRange(const char* name, double value, double above, double below) {
  if (value > above && value < below) return OkStatus();
  return InvalidArgument("option {}: {}, expected in ({}, {})", name, value, above, below);
}

Status CheckAtLeast(const char* name, int value, int least) {
  if (value >= least) return OkStatus();
  return InvalidArgument("option {}: {}, expected {} or more", name, value, least);
}

}  // namespace

Status LocalizerOptions::Validate() const {
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("alpha", hypotheses.alpha, 0.0, 0.5));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("max_leaves", hypotheses.max_leaves, 1));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("gate_probability", hypotheses.gate_probability, 0.0, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("fov_enter", hypotheses.fov_enter, 0.0, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(
      CheckRange("fov_leave", hypotheses.fov_leave, 0.0, hypotheses.fov_enter));
  const FieldOfViewOptions& field_of_view = hypotheses.field_of_view;
  SHIFTMAP_RETURN_IF_ERROR(
      CheckRange("max_lidar_age_s", field_of_view.max_lidar_age_s, 0.0, kSecondsPerDay));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("visit_gap_s", hypotheses.visit_gap_s, 0.0, kSecondsPerDay));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("min_signatures", global_start.min_signatures, 3));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("min_probability", global_start.min_probability, 0.5, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("window_s", global_start.window_s, 0.0, kSecondsPerDay));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("lost_s", health.lost_s, 0.0, kSecondsPerDay));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("min_observations", health.min_observations, 1));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("lost_share", health.lost_share, 0.0, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("found_share", health.found_share, health.lost_share, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("min_pairs", health.min_pairs, 1));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("min_pair_share", health.min_pair_share, 0.0, 1.0));
  SHIFTMAP_RETURN_IF_ERROR(
      CheckRange("max_position_sd_m", max_position_sd_m, 0.0, kMaxStartPositionSdM));
  SHIFTMAP_RETURN_IF_ERROR(CheckRange("state_hold_s", state_hold_s, 0.0, kSecondsPerDay));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("min_sightings", min_sightings, 1));
  SHIFTMAP_RETURN_IF_ERROR(CheckAtLeast("max_places", max_places, 1));
  SHIFTMAP_RETURN_IF_ERROR(limits.Validate());
  constexpr double kMaxDelay = 60.0;
  if (!(max_delay_s >= 0.0 && max_delay_s <= kMaxDelay)) {
    return InvalidArgument("option max_delay_s: {}, expected in [0, {}]", max_delay_s, kMaxDelay);
  }
  return initial_pose ? ValidateStart(*initial_pose) : OkStatus();
}

}  // namespace shiftmap
