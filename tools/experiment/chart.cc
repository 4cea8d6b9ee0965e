// SPDX-License-Identifier: Apache-2.0
#include "tools/experiment/chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "tools/plot/svg.h"
#include "tools/plot/ticks.h"

namespace shiftmap {
namespace {

constexpr double kWidth = 760.0;
constexpr double kHeight = 440.0;
constexpr double kLeft = 70.0;
constexpr double kRight = 170.0;  // Holds the legend.
constexpr double kTop = 52.0;
constexpr double kBottom = 55.0;

// Colours that people who see few colours tell apart (Okabe and Ito), and dashes for the rest.
constexpr std::array<const char*, 8> kColours = {
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#8C6D31"};
constexpr std::array<const char*, 4> kDashes = {"", "8 4", "2 3", "10 3 2 3"};

// One axis: data on it, and pixels.
struct Axis {
  double min = std::numeric_limits<double>::infinity();
  double max = -std::numeric_limits<double>::infinity();
  bool log = false;
  double pixel_min = 0.0;
  double pixel_max = 0.0;

  double Scale(double value) const { return log ? std::log10(value) : value; }
  bool Shows(double value) const { return std::isfinite(value) && (!log || value > 0.0); }
  void Include(double value) {
    min = std::min(min, value);
    max = std::max(max, value);
  }
  double Pixel(double value) const {
    const double share = (Scale(value) - Scale(min)) / (Scale(max) - Scale(min));
    return pixel_min + share * (pixel_max - pixel_min);
  }
};

struct Axes {
  Axis x;
  Axis y;
  bool Shows(const Eigen::Vector2d& point) const {
    return x.Shows(point.x()) && y.Shows(point.y());
  }
  Eigen::Vector2d Pixel(const Eigen::Vector2d& point) const {
    return {x.Pixel(point.x()), y.Pixel(point.y())};
  }
};

// Room at the ends, so that no point lies on the frame; something to show where there is nothing.
void Widen(Axis* axis) {
  if (!(axis->min <= axis->max)) {
    axis->min = axis->log ? 1.0 : 0.0;
    axis->max = axis->log ? 10.0 : 1.0;
  }
  if (axis->log) {
    axis->min = std::pow(10.0, std::floor(std::log10(axis->min)));
    axis->max = std::pow(10.0, std::ceil(std::log10(axis->max)));
    if (axis->max <= axis->min) axis->max = 10.0 * axis->min;
    return;
  }
  const double margin = axis->max > axis->min ? 0.04 * (axis->max - axis->min) : 0.5;
  // A quantity that is never negative starts at zero.
  axis->min = axis->min >= 0.0 && axis->min < 0.5 * axis->max ? 0.0 : axis->min - margin;
  axis->max += margin;
}

// Extends the axis that shows less per pixel.
void Equalize(Axes* axes) {
  const auto units_per_pixel = [](const Axis& axis) {
    return (axis.max - axis.min) / std::abs(axis.pixel_max - axis.pixel_min);
  };
  const double wanted = std::max(units_per_pixel(axes->x), units_per_pixel(axes->y));
  for (Axis* axis : {&axes->x, &axes->y}) {
    const double missing =
        0.5 * (wanted - units_per_pixel(*axis)) * std::abs(axis->pixel_max - axis->pixel_min);
    axis->min -= missing;
    axis->max += missing;
  }
}

Axes FitAxes(const Chart& chart) {
  Axes axes;
  axes.y.log = chart.log_y;
  axes.x.pixel_min = kLeft;
  axes.x.pixel_max = kWidth - kRight;
  axes.y.pixel_min = kHeight - kBottom;
  axes.y.pixel_max = kTop;
  for (const ChartSeries& series : chart.series) {
    for (const Eigen::Vector2d& point : series.points) {
      if (!axes.Shows(point)) continue;
      axes.x.Include(point.x());
      axes.y.Include(point.y());
    }
  }
  Widen(&axes.x);
  Widen(&axes.y);
  if (chart.equal_axes) Equalize(&axes);
  return axes;
}

void DrawFrame(const Chart& chart, const Axes& axes, Svg* svg) {
  constexpr int kTicks = 7;
  const SvgStyle grid{.stroke = "#DDDDDD"};
  for (const double tick : LinearTicks(axes.x.min, axes.x.max, kTicks)) {
    const double x = axes.x.Pixel(tick);
    svg->Line({x, axes.y.pixel_min}, {x, axes.y.pixel_max}, grid);
    svg->Text(
        {x, axes.y.pixel_min + 18.0}, fmt::format("{:.6g}", tick), {.anchor = SvgAnchor::kMiddle});
  }
  const std::vector<double> y_ticks =
      chart.log_y ? LogTicks(axes.y.min, axes.y.max) : LinearTicks(axes.y.min, axes.y.max, kTicks);
  for (const double tick : y_ticks) {
    const double y = axes.y.Pixel(tick);
    svg->Line({axes.x.pixel_min, y}, {axes.x.pixel_max, y}, grid);
    svg->Text({axes.x.pixel_min - 8.0, y + 4.0},
              fmt::format("{:.6g}", tick),
              {.anchor = SvgAnchor::kEnd});
  }
  svg->Rect({axes.x.pixel_min, axes.y.pixel_max},
            {axes.x.pixel_max - axes.x.pixel_min, axes.y.pixel_min - axes.y.pixel_max},
            {.stroke = "#444444"});
  const double middle = 0.5 * (axes.x.pixel_min + axes.x.pixel_max);
  svg->Text({middle, kHeight - 14.0}, chart.x_label, {.size = 13.0, .anchor = SvgAnchor::kMiddle});
  svg->Text({12.0, kTop - 9.0}, chart.y_label, {.size = 13.0});
  svg->Text(
      {middle, 20.0}, chart.title, {.size = 14.0, .anchor = SvgAnchor::kMiddle, .bold = true});
}

// Lines that are drawn later are thinner: where lines coincide, those below still show.
double LineWidth(std::size_t index) {
  return std::max(1.5, 4.0 - 0.4 * static_cast<double>(index));
}

void DrawSeries(const ChartSeries& series, std::size_t index, const Axes& axes, Svg* svg) {
  const std::string colour = kColours[index % kColours.size()];
  std::vector<Eigen::Vector2d> pixels;
  for (const Eigen::Vector2d& point : series.points) {
    if (axes.Shows(point)) pixels.push_back(axes.Pixel(point));
  }
  const SvgStyle line{
      .stroke = colour, .stroke_width = LineWidth(index), .dash = kDashes[index % kDashes.size()]};
  if (series.line && pixels.size() > 1) svg->Polyline(pixels, line);
  for (const Eigen::Vector2d& pixel : pixels)
    svg->Circle(pixel, series.marker_radius, {.fill = colour});
}

void DrawLegend(const Chart& chart, Svg* svg) {
  double y = kTop + 12.0;
  const double x = kWidth - kRight + 12.0;
  for (std::size_t i = 0; i < chart.series.size(); ++i) {
    if (chart.series[i].name.empty()) continue;
    const std::string colour = kColours[i % kColours.size()];
    if (chart.series[i].line) {
      svg->Line(
          {x, y},
          {x + 26.0, y},
          {.stroke = colour, .stroke_width = LineWidth(i), .dash = kDashes[i % kDashes.size()]});
    }
    svg->Circle({x + 13.0, y}, chart.series[i].marker_radius, {.fill = colour});
    svg->Text({x + 32.0, y + 4.0}, chart.series[i].name, {});
    y += 20.0;
  }
}

}  // namespace

ChartSeries& SeriesNamed(const std::string& name, Chart* chart) {
  for (ChartSeries& series : chart->series) {
    if (series.name == name) return series;
  }
  return chart->series.emplace_back(ChartSeries{name});
}

std::string DrawChart(const Chart& chart) {
  const Axes axes = FitAxes(chart);
  Svg svg(kWidth, kHeight);
  svg.Rect({0.0, 0.0}, {kWidth, kHeight}, {.fill = "#FFFFFF"});
  DrawFrame(chart, axes, &svg);
  for (std::size_t i = 0; i < chart.series.size(); ++i) DrawSeries(chart.series[i], i, axes, &svg);
  DrawLegend(chart, &svg);
  return svg.ToString();
}

}  // namespace shiftmap
