// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json_fwd.hpp>

#include "mapstore/map/snapshot_info.h"

namespace shiftmap {

/// A snapshot's description as files have it: the index of a map server's folder, and what a
/// vehicle keeps beside a snapshot that it has a part of. Signatures are in hex.
nlohmann::ordered_json SnapshotJson(const SnapshotInfo& snapshot);

/// Throws what nlohmann::json throws where something is missing or of another kind.
SnapshotInfo SnapshotFromJson(const nlohmann::ordered_json& json);

}  // namespace shiftmap
