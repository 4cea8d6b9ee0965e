// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>

#include "localizer/initialization/sighting_clusters.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

struct GlobalStartOptions {
  /// Signatures that must agree on a pose, >= 3: two always agree on some. [-]
  int min_signatures = 3;
  /// By how many signatures the best pose must beat every clearly different one, >= 1. [-]
  int min_margin = 2;
  /// Scans older than this are forgotten while no start is found, > 0. [s]
  double window_s = 60.0;
};

/// A pose that the sightings of a window agree on.
struct GlobalStart {
  PoseWithCovariance pose;  ///< At that scan.
  std::size_t scan = 0;     ///< Of the window; scans before it tell nothing.
  int explained = 0;        ///< Signatures that one of their modes explains.
  int runner_up = 0;        ///< The same for the best clearly different pose.
};

/// Finds the vehicle on the map by consensus over (signature, mode) candidates.
///
/// Every two landmarks seen, with every two modes of theirs that are as far apart as the two were
/// seen, give a pose; its score is the number of signatures that *any* of their modes explains. The
/// probabilities of the modes break ties only: after a change of layout the likely modes are the
/// wrong ones. The best poses are refined by weighted least squares over what they explain.
///
/// The start is as far back in the window as dead reckoning is still good for, 0.2 m and 0.1 rad,
/// from where the landmarks were seen. A vaguer pose would follow the first landmark that moved.
/// @param window  Scans with the motion between them; not empty.
/// @return Nothing as long as too few signatures agree or another pose explains almost as many,
///         or if ValidateStart() refuses it.
std::optional<GlobalStart> FindGlobalStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options);

}  // namespace shiftmap
