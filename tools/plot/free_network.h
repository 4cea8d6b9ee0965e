// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "mapstore/map/map_snapshot.h"

namespace shiftmap {

/// A map whose modes have the covariances of a free network: of their positions to each other,
/// without what is common to all.
struct FreeMap {
  MapContent content;      ///< Covariances between modes are left out.
  bool connected = false;  ///< Whether any two modes have a covariance.
  double scale_sd = 0.0;   ///< Of the scale of the largest network; 0 if there is none. [1]
};

/// Frees a map from its frame. In the frame of a map without survey, the first pose of the first
/// run, ellipses are wedges that grow with the distance from there; and a scale that is badly known
/// makes thorns of them. Here the frame and the scale are those that fit all modes best, by inner
/// constraints (STransformation) in the directions of translation, rotation and scale.
///
/// Modes that the map's covariance does not connect are networks of their own; of fewer than three
/// modes, or with all of them at one place, they stay as they are. O(blocks of the covariance).
FreeMap FreeNetwork(const MapContent& content);

}  // namespace shiftmap
