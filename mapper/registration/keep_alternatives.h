// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "mapper/alignment/explanation.h"
#include "mapper/registration/mode_match.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapper/state/undecided_runs.h"

namespace shiftmap {

/// What is in doubt of a run map whose place is decided: which of its landmarks stayed, where they
/// are told apart from where they were. These become unknown modes, if enough others hold the
/// run map. Nothing if nothing is in doubt.
/// @param frame    The alternatives and what stays in them.
/// @param decided  What is as probable as that is in no doubt.
/// @param apart    Modes of the run map that differ significantly from the nearest of the map.
/// @param matches  Of the run map, moved into the map frame.
std::optional<KeptAlternatives> KeepAlternatives(const StayedPosterior& frame,
                                                 double decided,
                                                 const ModeFlags& apart,
                                                 const RunMap& run_map,
                                                 const ModeMatches& matches,
                                                 KnownModes* known);

/// Whether a probability is neither that of `decided` nor that of its opposite.
inline bool LeavesDoubt(double probability, double decided) {
  return probability > 1.0 - decided && probability < decided;
}

/// Whether it is in doubt if a group stayed.
bool IsInDoubt(const KeptAlternatives& kept, GroupIndex group);

}  // namespace shiftmap
