// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <vector>

#include "mapper/selection/mode_sequence.h"
#include "tools/experiment/incremental/incremental_options.h"
#include "tools/experiment/incremental/window.h"

namespace shiftmap {

/// One landmark as the incremental mapper knows it.
struct IncrementalGroup {
  /// Its modes, indices in Window::modes; states of its chain. Those of the map come first.
  std::vector<int> modes;
  int known = 0;  ///< How many of them the map has.

  /// Index in `modes` of the last choice before the window; kNoMode: all are equally likely.
  int choice_before = kNoMode;
};

/// Where a step of a chain was seen.
struct SightingRef {
  int frame = -1;  ///< In the window; -1 for a step in which the landmark was not seen.
  int observation = 0;
};

/// A group's chain over the frames of the window, IJRR (19), with a step for each in which the
/// group was seen or could have been.
struct ModeWindow {
  ModeSequenceProblem problem;
  std::vector<SightingRef> sightings;  ///< Per step.
};

/// The chain at the present estimates: detections are weighed by IJRR (27, 31) with poses and modes
/// taken as given, as IJRR (23) does; observations without a mode are left out. It starts from the
/// last choice before the window. The max-mixture's weights do not depend on the past and are
/// equal. Precondition: an observation of the group in the window has a mode.
ModeWindow MakeModeWindow(const Window& window,
                          int group_index,
                          const IncrementalGroup& group,
                          const IncrementalOptions& options);

}  // namespace shiftmap
