// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "proto/core/status.h"
#include "tools/experiment/ijrr_utias_data.h"
#include "tools/experiment/ijrr_utias_score.h"
#include "tools/experiment/ijrr_utias_static.h"
#include "tools/experiment/incremental/incremental_options.h"

namespace shiftmap {

/// The settings of IJRR 8.2.2 for one of its selectors: modes made at once beyond a gate of 0.95
/// and never merged, P_D = 0.6.
/// @param noise  As it is told to the mapper.
IncrementalOptions PrintedSelectorOptions(SelectorKind kind,
                                          const UtiasNoise& noise,
                                          const UtiasProtocol& protocol);

/// Those of the incremental mapper itself: its defaults, Viterbi.
IncrementalOptions OwnSelectorOptions(const UtiasNoise& noise, const UtiasProtocol& protocol);

/// Maps the run frame by frame. What the paper leaves open: the run starts where motion capture has
/// it, with a standard deviation of 0.05 m and 0.02 rad. Errors: as IncrementalMapper.
StatusOr<UtiasEstimate> SolveFrameByFrame(const UtiasCase& data,
                                          const UtiasNoise& noise,
                                          const LandmarkPlaces& map,
                                          double prior_sd_m,
                                          const IncrementalOptions& options);

}  // namespace shiftmap
