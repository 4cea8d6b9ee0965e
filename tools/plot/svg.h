// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <string_view>

namespace shiftmap {

/// How a shape is drawn. Colours as in CSS.
struct SvgStyle {
  std::string stroke = "none";
  double stroke_width = 1.0;
  std::string fill = "none";
  double opacity = 1.0;
  std::string dash = "";      ///< E.g. "4 3"; empty for a solid line.
  double fill_opacity = 1.0;  ///< Of the fill alone, as a factor of `opacity`.
};

enum class SvgAnchor { kStart, kMiddle, kEnd };

struct SvgText {
  double size = 12.0;
  std::string fill = "#222222";
  SvgAnchor anchor = SvgAnchor::kStart;
  bool bold = false;
  bool halo = false;  ///< A white rim, so that it reads on top of lines.
};

/// A picture as SVG text. Coordinates in pixels, x to the right, y down. Text of any bytes is
/// shown, and never markup: InertLine(), escaped.
class Svg {
 public:
  Svg(double width, double height);

  void Line(const Eigen::Vector2d& from, const Eigen::Vector2d& to, const SvgStyle& style);
  void Polyline(std::span<const Eigen::Vector2d> points, const SvgStyle& style);

  /// @param tooltip  Shown by browsers under the pointer; empty for none.
  void Polygon(std::span<const Eigen::Vector2d> points,
               const SvgStyle& style,
               const std::string& tooltip = "");
  void Rect(const Eigen::Vector2d& corner,
            const Eigen::Vector2d& size,
            const SvgStyle& style,
            const std::string& tooltip = "");
  void Circle(const Eigen::Vector2d& centre,
              double radius,
              const SvgStyle& style,
              const std::string& tooltip = "");

  /// @param rotation_rad  Of the first half axis, from x towards y (which is down).
  void Ellipse(const Eigen::Vector2d& centre,
               const Eigen::Vector2d& half_axes,
               double rotation_rad,
               const SvgStyle& style);

  /// Round dots of one colour, in one short element however many they are.
  void Dots(std::span<const Eigen::Vector2d> centres,
            double radius,
            const std::string& color,
            double opacity = 1.0);

  /// Separate lines of one style, from each point of even index to the next one, in one element.
  void Segments(std::span<const Eigen::Vector2d> ends, const SvgStyle& style);

  /// A line with a head of `head` pixels at its end. Shorter ones have a smaller head.
  void Arrow(const Eigen::Vector2d& from,
             const Eigen::Vector2d& to,
             double head,
             const SvgStyle& style);

  /// @param at  Start, middle or end of the base line, by the anchor.
  void Text(const Eigen::Vector2d& at, std::string_view text, const SvgText& style);

  /// The whole document.
  std::string ToString() const;

  /// Width that a text will take, estimated from the advances of DejaVu Sans. [px]
  static double TextWidth(std::string_view text, double size, bool bold = false);

  /// `text`, or its begin and an ellipsis if it is wider than that.
  static std::string Shortened(std::string_view text, double size, double width, bool bold = false);

 private:
  void Close(std::string_view element, const std::string& tooltip);

  double width_;
  double height_;
  std::string body_;
};

}  // namespace shiftmap
