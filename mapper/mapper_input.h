// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapper/mapper_options.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/run.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A run as the mapper takes it.
struct MapperInput {
  std::string name;    ///< For messages and files: the log's stem.
  std::string sha256;  ///< Of the log file; orders runs that begin at the same time.
  Run run;
};

/// Errors: kInvalidArgument naming what is out of range, of the options, a run or the prior map.
Status CheckInputs(const std::vector<MapperInput>& inputs,
                   const std::optional<MapContent>& prior,
                   const MapperOptions& options);

/// The order of time, whatever order the inputs were named in.
void SortByBegin(std::vector<MapperInput>* inputs);

}  // namespace shiftmap
