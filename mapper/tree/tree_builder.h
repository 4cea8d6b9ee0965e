// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/mapper.h"
#include "mapper/tree/tree_options.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Builds a map of one area by TreeSlam, T-IV Algorithm 1, instead of BuildMap()'s graph: runs are
/// filtered one after the other in the order of time, each from where FindRunStart() has it on the
/// map so far. The result is of the same form. Poses and evidence are filtered: later sightings do
/// not correct earlier ones.
///
/// Of `options` it uses front_end, calibration, calibrate, sd_range_scale, chains, ledger and
/// clock, and modes.leave_rate_per_s; with `calibrate` odometry and sensor come from each run's
/// pairs of sightings, and without a prior map the field of view and the detection probability from
/// a first pass.
/// Errors: as BuildMap().
StatusOr<MapperResult> BuildMapByTree(std::vector<MapperInput> inputs,
                                      const std::optional<MapContent>& prior,
                                      const MapperOptions& options,
                                      const TreeSlamOptions& tree,
                                      const MapperMonitor& monitor = {});

}  // namespace shiftmap
