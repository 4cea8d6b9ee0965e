// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>

#include "mapper/alignment/explain_alignment.h"
#include "mapper/mapper_options.h"
#include "mapper/problem/map_problem.h"
#include "mapper/submaps/submap.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// Whether so few landmarks agree in a consensus that another one may explain the submap as well
/// (ConfirmationOptions).
/// @param reference  Modes of the map.
bool NeedsConfirmation(const ConfirmationOptions& options,
                       const std::vector<AlignmentPoint>& reference,
                       const Submap& submap,
                       const Alignment& consensus);

/// Where a submap lies in the map, by the joint covariances of both (Explain). A map that is solved
/// from runs has the variance factor that these show, and so has the submap; of a prior map, whose
/// residuals are not kept, it is taken to be that of the submap.
///
/// Nothing is returned for maps beyond ConfirmationOptions::max_modes.
/// @param prior    The map that the build started from.
/// @param problem  The map so far, with the modes of `prior`.
/// @param area_m2  That the map takes. [m²]
std::optional<Explanations> ExplainSubmap(const MapperOptions& options,
                                          const std::optional<MapContent>& prior,
                                          const MapProblem& problem,
                                          double area_m2,
                                          const Submap& submap);

/// The frame that the explanations decide for, or null.
const Explanation* Decided(const ConfirmationOptions& options, const Explanations& explanations);

}  // namespace shiftmap
