// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <functional>
#include <string>
#include <vector>

#include "tools/plot/svg.h"

namespace shiftmap {

/// The column of symbols and notes at the right of a picture. Long text goes on in the next line.
class Legend {
 public:
  /// Draws a symbol within 20 x 16 px around a point.
  using Symbol = std::function<void(const Eigen::Vector2d& centre, Svg* svg)>;

  static constexpr double kWidth = 250.0;

  void Heading(const std::string& text);
  void Entry(Symbol symbol, const std::string& text);

  /// Text without a symbol, in grey. One line: what does not fit is cut off.
  void Note(const std::string& text, bool one_line = false);

  /// [px]
  double height() const { return height_; }

  /// @param corner  The upper left one.
  void Draw(const Eigen::Vector2d& corner, Svg* svg) const;

 private:
  struct Line {
    double y;
    double x;
    std::string text;
    SvgText style;
    Symbol symbol;
  };

  void Add(const std::string& text, double x, const SvgText& style, Symbol symbol, bool one_line);

  std::vector<Line> lines_;
  double height_ = 0.0;
};

/// Title and subtitle at the head of any picture, 64 px high.
void DrawTitles(
    const std::string& title, const std::string& subtitle, double left, double width, Svg* svg);

}  // namespace shiftmap
