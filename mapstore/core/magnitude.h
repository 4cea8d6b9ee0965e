// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// Of numbers that are taken in from outside, in metres, radians or per second. Beyond it squares,
/// and their sums, overflow sooner or later.
inline constexpr double kMaxMagnitude = 1e9;

/// The same of variances.
inline constexpr double kMaxVariance = kMaxMagnitude * kMaxMagnitude;

/// Least of positive numbers that are squared and divided by, as standard deviations are.
inline constexpr double kMinMagnitude = 1e-30;

}  // namespace shiftmap
