// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>

#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// The version that a build goes on from: the newest of a version and its ancestors that the store
/// has the content of, that no excluded run went into, and no geometry that was taken back. Nothing
/// if there is none: builds start anew then.
/// @param passed_over  Gets a line for each that rests on what was taken out; may be null.
/// Errors: those of the store.
StatusOr<std::optional<VersionNumber>> FindPriorVersion(
    const std::string& area,
    VersionNumber version,
    const std::function<void(const std::string& line)>& passed_over,
    MapStore* store);

}  // namespace shiftmap
