// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

namespace shiftmap {

/// Points that belong together, in the order of x where a line joins them.
struct ChartSeries {
  std::string name;  ///< In the legend; empty for none.
  std::vector<Eigen::Vector2d> points = {};
  bool line = true;
  double marker_radius = 3.0;  ///< [px]
};

/// A figure with two axes. Points that are not finite, or not positive on a logarithmic axis, are
/// left out.
struct Chart {
  std::string title;
  std::string x_label;
  std::string y_label;
  std::vector<ChartSeries> series = {};
  bool log_y = false;
  bool equal_axes = false;  ///< One unit is as long on either axis, as on a map.
};

/// The chart's series of that name; a new one, joined by a line, if there is none.
/// @return Valid until the chart's series change.
ChartSeries& SeriesNamed(const std::string& name, Chart* chart);

/// The chart as an SVG document.
std::string DrawChart(const Chart& chart);

}  // namespace shiftmap
