// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapper/registration/mode_match.h"
#include "mapper/registration/run_map_alignment.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/build_state.h"
#include "mapper/state/kept_alternatives.h"

namespace shiftmap {

/// What is in doubt of a run map whose place is decided: which of its landmarks stayed, where they
/// are told apart from where they were. These become unknown modes, if enough others hold the
/// run map. Nothing if nothing is in doubt.
/// @param mode_matches  Of the run map, moved into the map frame.
/// @param known       Per mode of the run map, flat, the mode of its group in the map, or
///                    kUnassigned.
std::optional<KeptAlternatives> KeepAlternatives(const MapperOptions& options,
                                                 const RunMapAlignment& aligned,
                                                 const RunMap& run_map,
                                                 const std::vector<ModeMatch>& mode_matches,
                                                 const BuildState& build,
                                                 std::vector<int>* known);

/// Whether it is in doubt if a group stayed.
bool IsInDoubt(const std::optional<KeptAlternatives>& kept, int group);

}  // namespace shiftmap
