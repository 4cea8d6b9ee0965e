// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

#include "mapper/frontend/mapping_run.h"

namespace shiftmap {

/// Some key frames [first, last) of a run as a run of its own. A visit that goes on beyond them is
/// one in either part.
/// Precondition: 0 <= first < last <= frames.
MappingRun PartOf(const MappingRun& run, int first, int last);

/// Where parts of a run begin that each take about `part_s` [s], ascending, the first at 0. Each
/// has a key frame.
std::vector<int> PartStarts(const MappingRun& run, double part_s);

}  // namespace shiftmap
