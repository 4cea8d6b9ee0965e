// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace shiftmap {

/// How much the systematic errors of one run differ from those of its vehicle: standard deviations.
struct RunSpread {
  double log_scale = 0.025;
  double lag_s = 0.01;
  double bearing_offset_rad = 0.01;
  double range_curvature_per_rad2 = 0.02;
};
inline constexpr RunSpread kRunSpread;

}  // namespace shiftmap
