// SPDX-License-Identifier: Apache-2.0
//
// A map to and from its generated type. Inside codec/ only.
#pragma once

#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"
#include "proto/map.pb.h"

namespace shiftmap {

/// Errors: kInvalidArgument if a name is not UTF-8.
Status ToProto(const MapSnapshot& map, proto::Map* out);

/// Errors: as DecodeMap.
StatusOr<MapSnapshot> MapFromProto(const proto::Map& in);

}  // namespace shiftmap
