// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// A map whose modes have the covariances of a free network: of their positions to each other,
/// without what is common to all, which is the frame's. In the frame of a map without survey, the
/// first pose of the first run, ellipses are wedges that grow with the distance from there. Here
/// the frame is the one that fits all modes best, by inner constraints (Baarda's S-transformation):
///
///   P' = S P Sᵀ,  S = I - G (GᵀG)⁻¹ Gᵀ,  G the directions of translation and rotation
///
/// Modes that the map's covariance does not connect are networks of their own; of fewer than three
/// modes they stay as they are. Covariances between modes are left out of the result.
MapContent FreeNetwork(const MapContent& content);

}  // namespace shiftmap
