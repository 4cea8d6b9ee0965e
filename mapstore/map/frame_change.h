// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "mapstore/geometry/se2.h"
#include "mapstore/map/map_edit.h"
#include "mapstore/map/map_snapshot.h"
#include "mapstore/run/trajectory.h"

namespace shiftmap {

/// Moves a map as a whole: positions and covariances.
void MoveContent(const Se2& T_new_old, MapContent* content);

/// Moves a trajectory to another map frame.
void MoveTrajectory(const Se2& T_new_old, std::vector<StampedPose>* trajectory);

/// A map without covariances between modes, and with the names of a later one.
/// @param from_names, to_names  Of the edits that each map is made with.
MapContent WithNames(MapContent from,
                     const LandmarkNames& from_names,
                     const LandmarkNames& to_names);

/// The rigid motion that most modes of two maps share: least trimmed squares over the modes that
/// both maps have, then least squares over those that it explains. Fewer than two common modes give
/// the identity.
/// @return T_to_from. Determinism: a function of the maps.
Se2 FitFrame(const MapContent& from, const MapContent& to);

/// A map with the names, and in the frame, of a later one.
struct CarriedMap {
  MapContent content;
  std::vector<std::pair<Signature, Signature>> renamed;  ///< Name before and after, by the former.

  /// T_to_from, if the frame moved: more than half of at least three common modes are beyond their
  /// covariance, and the motion takes off more than half of the median distance.
  std::optional<Se2> moved;
};

/// Carries a map to a later one, so that a comparison shows the changes that are neither a name nor
/// the frame. Modes that the motion explains to 1 µm are exactly where the later map has them.
/// @param from_names, to_names  Of the edits that each map is made with.
CarriedMap CarryMap(const MapContent& from,
                    const LandmarkNames& from_names,
                    const MapContent& to,
                    const LandmarkNames& to_names);

}  // namespace shiftmap
