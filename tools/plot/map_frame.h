// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "tools/plot/legend.h"
#include "tools/plot/svg.h"

namespace shiftmap {

/// Where the map frame lies in a picture: equal axes, x to the right, y up, metres to pixels.
class MapFrame {
 public:
  /// Around all points, with room at the edges. Positions beyond 1e12 m count as there.
  /// @param points  Map frame. [m]
  static MapFrame Around(std::span<const Eigen::Vector2d> points);

  Eigen::Vector2d Pixel(const Eigen::Vector2d& p_map) const;
  double pixels_per_m() const { return pixels_per_m_; }

  /// Of the frame: the upper left corner and the size. [px]
  const Eigen::Vector2d& corner() const { return corner_; }
  const Eigen::Vector2d& size() const { return size_; }

  /// Grid, ticks in metres, the frame.
  void DrawAxes(Svg* svg) const;

  /// @param left  Left end of the bar. [px]
  void DrawScaleBar(const Eigen::Vector2d& left, Svg* svg) const;

 private:
  Eigen::Vector2d min_ = Eigen::Vector2d::Zero();  // Map frame. [m]
  Eigen::Vector2d max_ = Eigen::Vector2d::Zero();
  double pixels_per_m_ = 1.0;
  double step_m_ = 1.0;  // Of the ticks.
  Eigen::Vector2d corner_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d size_ = Eigen::Vector2d::Zero();
};

/// What a picture of a map has around the map.
struct MapPage {
  std::string title;
  std::string subtitle;
  double below = 0.0;        ///< Room below the frame and its labels, for a chart. [px]
  double least_width = 0.0;  ///< Of the page. [px]
};

/// A page with titles, axes, legend and scale bar, for the rest to be drawn on.
Svg StartMapPage(const MapPage& page, const MapFrame& frame, const Legend& legend);

/// Where the part below the frame of such a page begins. [px]
double BelowMap(const MapFrame& frame, const Legend& legend);

/// The points of a line without which it would be off by more than `tolerance` somewhere (Douglas
/// and Peucker, Cartographica 10(2), 1973).
std::vector<Eigen::Vector2d> Thinned(std::span<const Eigen::Vector2d> points, double tolerance);

}  // namespace shiftmap
