// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "tools/plot/svg.h"

namespace shiftmap {

enum class AxisScale { kLinear, kLog, kTime };

/// One axis of a chart: the values that it shows, and the pixels where.
struct ChartAxis {
  std::string label = "";  ///< With the unit.
  AxisScale scale = AxisScale::kLinear;
  double min = 0.0;  ///< Of kTime in seconds since the epoch, UTC; of kLog > 0.
  double max = 1.0;  ///< Above `min`.
  double pixel_min = 0.0;
  double pixel_max = 1.0;
  bool ticks = true;  ///< False, of x: a grid without numbers, above another chart; of y: neither.

  /// The pixel of a value; values beyond the ends of the axis lie at its ends.
  double Pixel(double value) const;
};

/// Draws frame, grid and ticks of two axes, and their labels: of x below, of y above on the left.
/// Takes 44 px below the frame, 20 above it, and 54 on its left.
void DrawChartFrame(const ChartAxis& x, const ChartAxis& y, Svg* svg);

/// A range of values with room at both ends, for an axis; [0, 1] around a value if there is one
/// only. Log: whole powers of ten.
/// @param min  At most `max`; of a log scale > 0.
void SetRange(double min, double max, ChartAxis* axis);

/// A line whose points ascend in x, with at most four points per column of pixels: it covers the
/// same pixels, to the eye.
std::vector<Eigen::Vector2d> Condensed(std::span<const Eigen::Vector2d> points);

}  // namespace shiftmap
