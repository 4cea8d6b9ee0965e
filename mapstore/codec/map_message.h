// SPDX-License-Identifier: Apache-2.0
//
// A map at a time as a Map message (proto/map.proto), in the forms that Protobuf has for files that
// people read.
#pragma once

#include <cstddef>
#include <string>
#include <string_view>

#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

enum class MapForm {
  kBinary,  ///< Protobuf's wire format.
  kText,    ///< As TextFormat prints it.
  kJson,    ///< As Protobuf's JSON printer does: integers of 64 bits are strings.
};

/// Modes of one landmark that DecodeMap() accepts at most: a chain's matrix takes n² numbers.
inline constexpr std::size_t kMaxDecodedModes = 1000;

/// The map with the probabilities that the snapshot holds, to the last bit in every form.
/// Errors: kInvalidArgument if a name is not UTF-8.
StatusOr<std::string> EncodeMap(const MapSnapshot& map, MapForm form);

/// Decodes and checks an untrusted map. What EncodeMap() wrote comes back with an equal
/// ContentHash().
/// Errors: kInvalidArgument with line and column of malformed text, or as ValidateMapContent().
StatusOr<MapSnapshot> DecodeMap(std::string_view text, MapForm form);

}  // namespace shiftmap
