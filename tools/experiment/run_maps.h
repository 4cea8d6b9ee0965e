// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>

#include "mapper/mapper_options.h"
#include "mapstore/core/ids.h"
#include "mapstore/run/run.h"

namespace shiftmap {

/// The error of a run mapped by itself, without what a run cannot tell: where the map lies, how it
/// is turned and, to a few per cent, its scale.
struct RunMapError {
  int landmarks = 0;
  double rms_m = 0.0;            ///< Of the positions.
  double nees = 0.0;             ///< In the covariance that the map claims.
  double dof = 0.0;              ///< What `nees` is expected to be.
  double variance_factor = 1.0;  ///< By which the residuals say that the covariance is too small.
};

/// Maps a run by itself and compares landmarks that have one mode with where they stood.
/// @param places  Of the landmarks during the run. [m]
/// @return Nothing for a run that determines fewer than three.
std::optional<RunMapError> MeasureRunMap(const Run& run,
                                         const std::map<Signature, Eigen::Vector2d>& places,
                                         const MapperOptions& options);

}  // namespace shiftmap
