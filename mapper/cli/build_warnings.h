// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "mapper/cli/area_build.h"
#include "mapper/mapper.h"
#include "mapstore/cli/context.h"
#include "mapstore/store_types.h"

namespace shiftmap {

/// One line for each vehicle that was in two runs at one time, of a build or of one and the map.
std::vector<std::string> AtTwoPlaces(const std::vector<MapperInput>& inputs,
                                     const std::vector<LineRun>& known_runs);

/// Names the landmarks of logs that are codes on vehicles.
void WarnOfMoving(const std::vector<MapperInput>& inputs,
                  const FrontEndOptions& options,
                  const Context& context);

/// Warns of runs of the map whose vehicle was carried, or with observations that are left out.
void WarnOfOdd(const MapperResult& result, const Context& context);

/// Says which runs are left out or wait, and why.
void WarnOfRuns(const AreaBuild& build, Context& context);

}  // namespace shiftmap
