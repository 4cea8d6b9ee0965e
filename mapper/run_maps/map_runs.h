// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <vector>

#include "mapper/build_progress.h"
#include "mapper/frontend/mapping_run.h"
#include "mapper/mapper_options.h"
#include "mapper/run_maps/run_map.h"
#include "mapper/state/undecided_runs.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Maps each run by itself, side by side. A run whose calibration no vehicle has, whose
/// observations do not agree, or which does not determine its landmarks is rejected.
/// @param runs    Have to outlive the run maps.
/// @param groups  How many there are.
/// Errors: kCancelled.
StatusOr<std::vector<RunMap>> MapRuns(const std::vector<MappingRun>& runs,
                                      std::size_t groups,
                                      const MapperOptions& options,
                                      BuildWatch* watch,
                                      std::vector<RejectedRun>* rejected);

}  // namespace shiftmap
