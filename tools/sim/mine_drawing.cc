// SPDX-License-Identifier: Apache-2.0
#include "tools/sim/mine_drawing.h"

#include <png.h>

#include <Eigen/LU>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "mapstore/core/input_file.h"

namespace shiftmap {
namespace {

constexpr std::size_t kMaxPixels = 100'000'000;

// Pixel coordinates (column, row) to metres: p = offset + matrix · pixel.
struct PixelToMap {
  Eigen::Vector2d offset;
  Eigen::Matrix2d matrix;

  Eigen::Vector2d operator()(const Eigen::Vector2d& pixel) const { return offset + matrix * pixel; }
};

std::optional<std::array<double, 3>> ThreeNumbers(const nlohmann::json& object, const char* name) {
  if (!object.contains(name) || !object[name].is_array() || object[name].size() != 3) {
    return std::nullopt;
  }
  std::array<double, 3> numbers{};
  for (std::size_t i = 0; i < 3; ++i) {
    if (!object[name][i].is_number()) return std::nullopt;
    numbers[i] = object[name][i].get<double>();
  }
  return numbers;
}

std::optional<PixelToMap> ParseFrame(const nlohmann::json& document, const std::string& frame) {
  if (!document.contains(frame) || !document[frame].is_object()) return std::nullopt;
  const auto x = ThreeNumbers(document[frame], "x_m = x0 + xc*col + xr*row");
  const auto y = ThreeNumbers(document[frame], "y_m = y0 + yc*col + yr*row");
  if (!x || !y) return std::nullopt;
  PixelToMap map;
  map.offset << (*x)[0], (*y)[0];
  map.matrix << (*x)[1], (*x)[2], (*y)[1], (*y)[2];
  if (!std::isfinite(map.offset.sum()) || !(std::abs(map.matrix.determinant()) > 0.0)) {
    return std::nullopt;
  }
  return map;
}

// Edges between pixels, walked with what is dark on the right. Directions by turning left.
constexpr std::array<std::pair<int, int>, 4> kSteps = {{{1, 0}, {0, -1}, {-1, 0}, {0, 1}}};

// The pixels to the left and to the right of an edge that leaves the corner (x, y), which is the
// top left one of pixel (x, y).
std::pair<int, int> RightPixel(int x, int y, std::size_t direction) {
  constexpr std::array<std::pair<int, int>, 4> kRight = {{{0, 0}, {0, -1}, {-1, -1}, {-1, 0}}};
  return {x + kRight[direction].first, y + kRight[direction].second};
}

std::pair<int, int> LeftPixel(int x, int y, std::size_t direction) {
  return RightPixel(x, y, (direction + 1) % 4);
}

bool IsBorder(const GreyImage& image, int x, int y, std::size_t direction) {
  const auto [right_x, right_y] = RightPixel(x, y, direction);
  const auto [left_x, left_y] = LeftPixel(x, y, direction);
  return image.Dark(right_x, right_y) && !image.Dark(left_x, left_y);
}

// The corner of the closed line between `begin` and `end` that is furthest off the straight piece.
std::size_t Furthest(const std::vector<Eigen::Vector2d>& line,
                     std::size_t begin,
                     std::size_t end,
                     double* distance) {
  const Eigen::Vector2d& a = line[begin];
  const Eigen::Vector2d along = line[end % line.size()] - a;
  std::size_t furthest = begin;
  *distance = -1.0;
  for (std::size_t i = begin + 1; i < end; ++i) {
    const Eigen::Vector2d to = line[i] - a;
    const double share =
        along.isZero() ? 0.0 : std::clamp(to.dot(along) / along.squaredNorm(), 0.0, 1.0);
    const double off = (to - share * along).norm();
    if (off <= *distance) continue;
    *distance = off;
    furthest = i;
  }
  return furthest;
}

// The stretch of a wall inside of a window, if any.
std::optional<Wall> Crop(const Wall& wall, const MapWindow& window) {
  const Eigen::Vector2d along = wall.b - wall.a;
  const Eigen::Vector2d low(window.min_x_m, window.min_y_m);
  const Eigen::Vector2d high(window.max_x_m, window.max_y_m);
  double from = 0.0;
  double to = 1.0;
  for (int axis = 0; axis < 2; ++axis) {
    if (along[axis] == 0.0) {
      if (wall.a[axis] < low[axis] || wall.a[axis] > high[axis]) return std::nullopt;
      continue;
    }
    const double a = (low[axis] - wall.a[axis]) / along[axis];
    const double b = (high[axis] - wall.a[axis]) / along[axis];
    from = std::max(from, std::min(a, b));
    to = std::min(to, std::max(a, b));
  }
  if (from >= to) return std::nullopt;
  return Wall{wall.a + from * along, wall.a + to * along};
}

}  // namespace

StatusOr<GreyImage> ReadPng(const std::string& path) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string bytes, ReadInputFile("drawing", path));
  png_image png{};
  png.version = PNG_IMAGE_VERSION;
  if (png_image_begin_read_from_memory(&png, bytes.data(), bytes.size()) == 0) {
    return InvalidArgument("drawing '{}': no PNG file: {}", path, png.message);
  }
  png.format = PNG_FORMAT_GRAY;
  const std::size_t size = std::size_t{png.width} * std::size_t{png.height};
  if (size > kMaxPixels) {
    png_image_free(&png);
    return InvalidArgument("drawing '{}': {} pixels, expected at most {}", path, size, kMaxPixels);
  }
  GreyImage image{static_cast<int>(png.width), static_cast<int>(png.height), {}};
  image.pixels.resize(size);
  // What is transparent becomes white.
  png_color white{255, 255, 255};
  if (png_image_finish_read(&png, &white, image.pixels.data(), 0, nullptr) == 0) {
    return InvalidArgument("drawing '{}': damaged PNG file: {}", path, png.message);
  }
  return image;
}

std::vector<std::vector<Eigen::Vector2d>> BordersOf(const GreyImage& image) {
  std::vector<std::vector<Eigen::Vector2d>> borders;
  // Every border has an edge to the right, above a dark pixel: start there, and mark these.
  std::vector<bool> done(image.pixels.size(), false);
  const auto mark = [&](int x, int y) {
    return done[static_cast<std::size_t>(y) * static_cast<std::size_t>(image.columns) +
                static_cast<std::size_t>(x)];
  };
  for (int row = 0; row < image.rows; ++row) {
    for (int column = 0; column < image.columns; ++column) {
      if (!IsBorder(image, column, row, 0) || mark(column, row)) continue;
      std::vector<Eigen::Vector2d>& border = borders.emplace_back();
      int x = column;
      int y = row;
      std::size_t direction = 0;
      do {
        if (direction == 0) mark(x, y) = true;
        border.emplace_back(x - 0.5, y - 0.5);
        x += kSteps[direction].first;
        y += kSteps[direction].second;
        // A right turn first keeps to the same pixel, where another touches it at a corner.
        direction = (direction + 3) % 4;
        while (!IsBorder(image, x, y, direction)) direction = (direction + 1) % 4;
      } while (x != column || y != row || direction != 0);
    }
  }
  return borders;
}

std::vector<Eigen::Vector2d> Simplified(const std::vector<Eigen::Vector2d>& closed,
                                        double tolerance) {
  double distance = 0.0;
  // The first corner stays, and that furthest from it.
  const std::size_t opposite = Furthest(closed, 0, closed.size(), &distance);
  std::vector<bool> kept(closed.size(), false);
  kept[0] = kept[opposite] = true;
  std::vector<std::pair<std::size_t, std::size_t>> open = {{0, opposite},
                                                           {opposite, closed.size()}};
  while (!open.empty()) {
    const auto [begin, end] = open.back();
    open.pop_back();
    const std::size_t corner = Furthest(closed, begin, end, &distance);
    if (distance <= tolerance) continue;
    kept[corner] = true;
    open.emplace_back(begin, corner);
    open.emplace_back(corner, end);
  }
  std::vector<Eigen::Vector2d> corners;
  for (std::size_t i = 0; i < closed.size(); ++i) {
    if (kept[i]) corners.push_back(closed[i]);
  }
  return corners;
}

StatusOr<std::vector<Wall>> ReadMineDrawing(const std::string& georeference,
                                            const std::string& frame,
                                            const MapWindow& window,
                                            double tolerance_m) {
  SHIFTMAP_ASSIGN_OR_RETURN(const std::string text, ReadInputFile("georeference", georeference));
  const auto document = nlohmann::json::parse(text, nullptr, false);
  if (!document.is_object() || !document.contains("image") || !document["image"].is_string()) {
    return InvalidArgument("georeference '{}': no JSON object with an `image`", georeference);
  }
  const std::optional<PixelToMap> to_map = ParseFrame(document, frame);
  if (!to_map) {
    return InvalidArgument(
        "georeference '{}': no frame '{}' with six numbers", georeference, frame);
  }
  const std::filesystem::path folder = std::filesystem::path(georeference).parent_path();
  SHIFTMAP_ASSIGN_OR_RETURN(const GreyImage image,
                            ReadPng((folder / document["image"].get<std::string>()).string()));
  std::vector<Wall> walls;
  for (const std::vector<Eigen::Vector2d>& border : BordersOf(image)) {
    std::vector<Eigen::Vector2d> line;
    for (const Eigen::Vector2d& pixel : border) line.push_back((*to_map)(pixel));
    for (const Wall& wall : WallsAlong(Simplified(line, tolerance_m), true)) {
      if (const std::optional<Wall> inside = Crop(wall, window)) walls.push_back(*inside);
    }
  }
  if (walls.empty()) {
    return InvalidArgument("georeference '{}': no wall between ({}, {}) and ({}, {})",
                           georeference,
                           window.min_x_m,
                           window.min_y_m,
                           window.max_x_m,
                           window.max_y_m);
  }
  return walls;
}

}  // namespace shiftmap
