// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "mapstore/core/ids.h"
#include "mapstore/geometry/se2.h"
#include "mapstore/map/landmark_group.h"
#include "proto/core/status.h"

namespace shiftmap {

/// A place where a landmark really stood.
struct TruePlace {
  Signature signature;
  Eigen::Vector2d p_truth = Eigen::Vector2d::Zero();  ///< [m], in the frame of the truth.
};

/// Reads places from a CSV file whose first line names the columns, `signature`, `x_m` and `y_m`
/// among them, in any order.
/// Errors: kNotFound; kInvalidArgument with `<path>:<line>`.
StatusOr<std::vector<TruePlace>> ReadTruePlaces(const std::string& path);

/// A true place and the mode of its landmark that is nearest.
struct PlaceMatch {
  Signature signature;
  ModeNumber mode;
  double distance_m = 0.0;
};

struct MapError {
  std::vector<PlaceMatch> matches;   ///< In the order of the truth.
  std::vector<Signature> unmatched;  ///< True places of landmarks that the map does not have.
  double rmse_m = 0.0;
  double median_m = 0.0;
  double max_m = 0.0;
  Se2 T_truth_map;  ///< The alignment that was applied.
};

/// Distances between true places and the nearest modes with the same signature. With `align`, the
/// map is moved by one rigid transform first: of all that bring two places onto modes, the one that
/// most places agree with, then refined by least squares over those.
/// Errors: kInvalidArgument if no landmark is in both, or no alignment is found.
StatusOr<MapError> EvaluateMap(std::span<const LandmarkGroup> groups,
                               std::span<const TruePlace> truth,
                               bool align);

}  // namespace shiftmap
