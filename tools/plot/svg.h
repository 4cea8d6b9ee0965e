// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>

namespace shiftmap {

/// How a shape is drawn. Colours as in CSS.
struct SvgStyle {
  std::string stroke = "none";
  double stroke_width = 1.0;
  std::string fill = "none";
  double opacity = 1.0;
  std::string dash = "";  ///< E.g. "4 3"; empty for a solid line.
};

enum class SvgAnchor { kStart, kMiddle, kEnd };

struct SvgText {
  double size = 12.0;
  std::string fill = "#222222";
  SvgAnchor anchor = SvgAnchor::kStart;
  bool bold = false;
  bool halo = false;  ///< A white rim, so that it reads on top of lines.
};

/// A picture as SVG text. Coordinates in pixels, x to the right, y down.
class Svg {
 public:
  Svg(double width, double height);

  void Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const SvgStyle& style);
  void Polyline(std::span<const Eigen::Vector2d> points, const SvgStyle& style);
  void Rect(const Eigen::Vector2d& corner, const Eigen::Vector2d& size, const SvgStyle& style);

  /// @param tooltip  Shown by browsers under the pointer; empty for none.
  void Circle(const Eigen::Vector2d& centre,
              double radius,
              const SvgStyle& style,
              const std::string& tooltip = "");

  /// @param rotation_rad  Of the first half axis, from x towards y (which is down).
  void Ellipse(const Eigen::Vector2d& centre,
               const Eigen::Vector2d& half_axes,
               double rotation_rad,
               const SvgStyle& style);

  /// @param at  Start, middle or end of the base line, by the anchor.
  void Text(const Eigen::Vector2d& at, const std::string& text, const SvgText& style);

  /// The whole document.
  std::string ToString() const;

  /// Width that a text will take, estimated. [px]
  static double TextWidth(const std::string& text, double size);

 private:
  double width_;
  double height_;
  std::string body_;
};

}  // namespace shiftmap
