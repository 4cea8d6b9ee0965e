// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "mapstore/geometry/covariance.h"

namespace shiftmap {

/// `X,Y,YAW` in m, m, rad with the uncertainty of a pose that somebody typed; nothing if it is
/// something else, or ValidateStart() rejects it.
std::optional<PoseWithCovariance> ParseInitialPose(const std::string& text);

}  // namespace shiftmap
