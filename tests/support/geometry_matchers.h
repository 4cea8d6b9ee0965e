// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gmock/gmock.h>

#include <cmath>

#include "mapstore/geometry/angle.h"
#include "mapstore/geometry/se2.h"

namespace shiftmap::testing {

/// A pose within `tolerance` of `expected`, metres and radians; yaw compared modulo 2π.
MATCHER_P2(IsNearPose, expected, tolerance, "is near the pose") {
  const Se2& pose = arg;
  const Se2& want = expected;
  *result_listener << "(" << pose.x() << ", " << pose.y() << ", " << pose.yaw() << "), expected ("
                   << want.x() << ", " << want.y() << ", " << want.yaw() << ")";
  return std::abs(pose.x() - want.x()) <= tolerance && std::abs(pose.y() - want.y()) <= tolerance &&
         std::abs(WrapAngle(pose.yaw() - want.yaw())) <= tolerance;
}

/// A matrix or vector whose entries are all within `tolerance` of those of `expected`.
MATCHER_P2(IsNearMatrix, expected, tolerance, "is near the matrix") {
  if (arg.rows() != expected.rows() || arg.cols() != expected.cols()) {
    *result_listener << "is " << arg.rows() << " x " << arg.cols();
    return false;
  }
  const double error = arg.size() == 0 ? 0.0 : (arg - expected).cwiseAbs().maxCoeff();
  *result_listener << "differs by up to " << error;
  return error <= tolerance;
}

}  // namespace shiftmap::testing
