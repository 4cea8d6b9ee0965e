// SPDX-License-Identifier: Apache-2.0
//
// Walls from a scanned drawing of a mine.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "proto/core/status.h"
#include "tools/sim/wall.h"

namespace shiftmap {

/// A part of a map. [m]
struct MapWindow {
  double min_x_m = 0.0;
  double min_y_m = 0.0;
  double max_x_m = 0.0;
  double max_y_m = 0.0;
};

/// Reads the walls of a drawing: where its pixels change between dark and light, in straight pieces
/// that are off by at most the tolerance (D. H. Douglas, T. K. Peucker: Algorithms for the
/// reduction of the number of points required to represent a digitized line, Cartographica 10(2),
/// 1973).
/// @param georeference  A JSON file: `image`, a PNG beside it; per frame of reference an object
/// with
///                      `x_m = x0 + xc*col + xr*row` and `y_m = y0 + yc*col + yr*row`, three
///                      numbers each, of the centres of pixels. [m]
/// @param frame         Name of that object.
/// @param window        Of the map that is read. Walls end at its border.
/// @param tolerance_m   >= 0; below a pixel walls become stairs. [m]
/// Errors: kNotFound, kInvalidArgument for a file that is missing or is not this, or if the window
/// has no wall; messages start with the file.
StatusOr<std::vector<Wall>> ReadMineDrawing(const std::string& georeference,
                                            const std::string& frame,
                                            const MapWindow& window,
                                            double tolerance_m);

/// Grey values by row, from the top left.
struct GreyImage {
  int columns = 0;
  int rows = 0;
  std::vector<std::uint8_t> pixels;

  bool Dark(int column, int row) const {
    constexpr std::uint8_t kDarkBelow = 128;
    return column >= 0 && column < columns && row >= 0 && row < rows &&
           pixels[static_cast<std::size_t>(row) * static_cast<std::size_t>(columns) +
                  static_cast<std::size_t>(column)] < kDarkBelow;
  }
};

/// Reads a PNG file as grey. Errors: kNotFound, kInvalidArgument, also above 100 million pixels.
StatusOr<GreyImage> ReadPng(const std::string& path);

/// The borders of what is dark as closed lines in pixel coordinates, (column, row) of corners of
/// pixels less one half, so that integers are centres. Where two dark pixels touch at a corner
/// only, each has its own border.
std::vector<std::vector<Eigen::Vector2d>> BordersOf(const GreyImage& image);

/// A closed line with the corners that it needs to stay within the tolerance.
std::vector<Eigen::Vector2d> Simplified(const std::vector<Eigen::Vector2d>& closed,
                                        double tolerance);

}  // namespace shiftmap
