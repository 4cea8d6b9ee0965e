// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace shiftmap {

/// The value that a share of all values stays at or below, by linear interpolation between order
/// statistics (type 7 of Hyndman and Fan).
/// Precondition: there is a value, and the share is in [0, 1].
double Quantile(std::vector<double> values, double share);

}  // namespace shiftmap
