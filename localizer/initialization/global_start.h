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
  /// Probability that a start must have, against clearly different poses and against none that
  /// explains two landmarks, in (0.5, 1).
  double min_probability = 0.9999;
  /// Scans older than this are forgotten while no start is found, > 0. [s]
  double window_s = 60.0;
};

/// A pose that the sightings of a window agree on.
struct GlobalStart {
  PoseWithCovariance pose;  ///< At that scan.
  std::size_t scan = 0;     ///< Of the window; scans before it tell nothing.
  int explained = 0;        ///< Signatures that one of their modes explains.
  double probability = 0.0;
};

/// The pose of a start after the last scan of its window.
PoseWithCovariance PoseAtEnd(const GlobalStart& start, std::span<const WindowScan> window);

/// Finds the vehicle on the map by the posterior of poses that landmarks agree on.
///
/// Every two landmarks seen, with every two modes of theirs that are as far apart as the two were
/// seen, give a pose. Those that explain most signatures are refined by weighted least squares over
/// what they explain. The likelihood of a pose is that of all signatures: each was seen at a mode
/// of its landmark, or anywhere. Modes hold as probable as the map says, or, after a change of
/// layout, all alike. Derivation: localizer/METHOD.md, Start.
///
/// The start is as far back in the window as dead reckoning is still good for, 0.2 m and 0.1 rad,
/// from where the landmarks were seen. A vaguer pose would follow the first landmark that moved.
/// @param window  Scans with the motion between them; not empty.
/// @return Nothing as long as too few signatures agree or no pose is as probable as asked, or if
///         ValidateStart() refuses it.
std::optional<GlobalStart> FindGlobalStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options);

/// The same, where dead reckoning may have slipped in the window: of its newer half, its newest
/// quarter and so on, if the whole does not decide. What is older is not forgotten: a pose of a
/// part has to outweigh those of the longer ones, against the prior of a slip. Else the sightings
/// that contradict a pose would be left out until it is decided for.
std::optional<GlobalStart> FindRecentStart(std::span<const WindowScan> window,
                                           const MapSnapshot& snapshot,
                                           const GlobalStartOptions& options);

}  // namespace shiftmap
