// SPDX-License-Identifier: Apache-2.0
//
// What Foxglove draws of a shift, as bytes of its messages. Frames: `map`, and `vehicle` in it.
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <utility>

#include "mapstore/core/stamp.h"
#include "mapstore/geometry/covariance.h"
#include "mapstore/map/landmark_group.h"

namespace shiftmap {

std::string EncodePoseInFrame(Stamp stamp, const Se2& T_map_vehicle);
std::string EncodeFrameTransform(Stamp stamp, const Se2& T_map_vehicle);
std::string EncodePosesInFrame(Stamp stamp, std::span<const Se2> poses);

enum class LogLevel { kInfo, kWarning, kError };

/// @param text  One line; made inert.
std::string EncodeLog(Stamp stamp, LogLevel level, const std::string& text);

/// A landmark with the probabilities of its states; both are borrowed.
struct DrawnGroup {
  const LandmarkGroup* group = nullptr;
  const Eigen::VectorXd* probabilities = nullptr;  ///< As LandmarkGroup::probabilities.
};

/// An entity per group, which replaces the one before: of each mode a sphere, the 95 % ellipse of
/// its position and a label, opaque by the probability, and lines between the modes. An entity for
/// all anonymous landmarks if there are any.
std::string EncodeMapScene(Stamp stamp,
                           std::span<const DrawnGroup> groups,
                           std::span<const Mode> anonymous_landmarks);

/// One entity: of each leaf an arrow, opaque by its weight, and the 95 % ellipse of the estimate.
std::string EncodeLeafScene(Stamp stamp,
                            std::span<const std::pair<double, Se2>> leaves,
                            const PoseWithCovariance& estimate);

}  // namespace shiftmap
