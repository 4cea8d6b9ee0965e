// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "mapstore/core/stamp.h"
#include "mapstore/map/map_snapshot.h"
#include "proto/core/status.h"

namespace shiftmap {

/// Formats of a file that a map is imported from: `csv` (ReadSurvey()), `geojson`, `textproto` and
/// `protojson` as `shiftmap-inspect export` writes them, and `auto`: by the ending of the name,
/// `.geojson`, `.textproto`, `.protojson` or `.json`, else `csv`.
const std::vector<std::string>& MapFileFormats();

struct MapFileOptions {
  std::string format = "auto";  ///< Of MapFileFormats().

  /// When the probabilities hold; nothing: as the file says, or else `now`.
  std::optional<Stamp> stamp = std::nullopt;
  Stamp now = {};

  double leave_rate_per_s = 0.0;  ///< Of the chains that the file does not give. [1/s]
};

/// Reads a map from a file.
///
/// GeoJSON gives positions with marginal covariances, probabilities of modes (`absent` has the
/// rest) and leave rates; the calibration is then the default one. The other two give all of a map.
/// Errors: as ReadSurvey(); kInvalidArgument, naming feature or landmark, for what is malformed,
/// and for a GeoJSON whose coordinates are not stated to be metres in the map frame.
StatusOr<MapContent> ReadMapFile(const std::string& path, const MapFileOptions& options);

}  // namespace shiftmap
