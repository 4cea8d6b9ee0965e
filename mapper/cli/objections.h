// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/map/map_snapshot.h"
#include "mapstore/map_store.h"
#include "proto/core/status.h"

namespace shiftmap {

/// What a person is to decide before a build becomes the map of its area: a line for each run and
/// each edit in force that the published version has and the build lacks, and for control points
/// that the build contradicts. An area without a published version has none. Errors: those of the
/// store.
/// @param parent  The version that the build goes on from.
/// @param runs    Those of the build.
StatusOr<std::vector<std::string>> FindObjections(const std::string& area,
                                                  const std::optional<VersionNumber>& parent,
                                                  const std::vector<RunRecord>& runs,
                                                  const MapContent& content,
                                                  MapStore* store);

}  // namespace shiftmap
