// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <vector>

#include "mapper/index.h"
#include "mapper/mapper.h"
#include "mapper/mapper_options.h"
#include "mapper/state/build_state.h"
#include "mapstore/core/ids.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a build does not decide: runs that wait, and landmarks of which it is open whether they
/// moved.
std::vector<AmbiguousChange> AmbiguousChangesOf(
    const BuildState& build, const IndexedVector<GroupIndex, Signature>& signatures);

/// Fills the result from a solved build. Runs that do not determine their landmarks are taken out
/// and the rest is solved again.
/// Errors: kInvalidArgument if no run can be used or a value is out of range.
Status FillResult(const IndexedVector<GroupIndex, Signature>& signatures,
                  const std::optional<MapContent>& prior,
                  const MapperOptions& options,
                  BuildState* build,
                  MapperResult* result);

}  // namespace shiftmap
