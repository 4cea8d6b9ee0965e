// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "localizer/hypothesis/hypothesis_bank.h"
#include "localizer/initialization/global_start.h"
#include "localizer/monitor/health_monitor.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/run/item_limits.h"
#include "proto/core/status.h"

namespace shiftmap {

struct LocalizerOptions {
  HypothesisOptions hypotheses;
  GlobalStartOptions global_start;
  HealthOptions health;

  /// Pose at the first scan; nothing: found from the signatures seen.
  std::optional<PoseWithCovariance> initial_pose;

  /// With a position among the landmarks less certain than this in some direction the state is
  /// LOST, until it is twice as certain: standard deviation, > 0 and below kMaxStartPositionSdM.
  /// What the map as a whole is uncertain by does not count. [m]
  double max_position_sd_m = 3.0;

  /// How long MODE_CHANGED and UNKNOWN_CHANGE stay up after their cause was last seen, > 0. [s]
  double state_hold_s = 5.0;

  /// Sightings of a known signature at one unknown place that raise UNKNOWN_CHANGE, >= 1. [-]
  int min_sightings = 3;

  /// What an item may come later than a younger one, in [0, 60]. Everything is held for as long; 0:
  /// nothing is, and items come in order. [s]
  double max_delay_s = 0.0;

  /// Beyond them an item is dropped.
  LimitOptions limits;

  /// Places of landmarks that the map does not know, or not there, kept at most, >= 1: memory and
  /// the report grow with them. [-]
  int max_places = 10'000;

  /// Errors: kInvalidArgument, naming the first option out of range.
  Status Validate() const;
};

}  // namespace shiftmap
