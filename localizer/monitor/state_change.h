// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "localizer/localizer_state.h"
#include "localizer/monitor/health_monitor.h"
#include "mapstore/core/ids.h"

namespace shiftmap {

/// The numbers that a state rests on.
struct StateEvidence {
  Stamp stamp;
  PoseSupport support;         ///< What agrees with the pose and what does not.
  Signature signature;         ///< UNKNOWN_CHANGE, MODE_CHANGED: whose; otherwise empty.
  ModeNumber mode = kAbsent;   ///< MODE_CHANGED: the mode that took over.
  double log_odds = 0.0;       ///< MODE_CHANGED: of the decision.
  std::int64_t sightings = 0;  ///< UNKNOWN_CHANGE: at the new place; 0 if it was decided absent.
};

/// A change of the localizer's state.
struct StateChange {
  Stamp stamp;
  LocalizerState from = LocalizerState::kInitializing;
  LocalizerState to = LocalizerState::kInitializing;
  StateEvidence evidence;
};

}  // namespace shiftmap
