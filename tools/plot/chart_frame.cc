// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/chart_frame.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "tools/plot/palette.h"
#include "tools/plot/ticks.h"

namespace shiftmap {
namespace {

constexpr double kTickSize = 11.0;

struct Tick {
  double value;
  std::string label;
  std::string date;
};

std::vector<Tick> TicksOf(const ChartAxis& axis, int count) {
  std::vector<Tick> ticks;
  if (axis.scale == AxisScale::kTime) {
    for (const TimeTick& tick : TimeTicks(axis.min, axis.max, count)) {
      ticks.push_back({tick.time_s, tick.label, tick.date});
    }
  } else if (axis.scale == AxisScale::kLog) {
    const std::vector<double> powers = LogTicks(axis.min, axis.max);
    const std::size_t skip = powers.size() / static_cast<std::size_t>(count) + 1;
    for (std::size_t i = 0; i < powers.size(); i += skip) {
      ticks.push_back({powers[i], PowerLabel(powers[i]), ""});
    }
  } else {
    const std::vector<double> values = LinearTicks(axis.min, axis.max, count);
    const double step = values.size() > 1 ? values[1] - values[0] : axis.max - axis.min;
    for (const double value : values) ticks.push_back({value, LinearLabel(value, step), ""});
  }
  return ticks;
}

int TickCount(const ChartAxis& axis, double pixels) {
  return std::max(2, static_cast<int>(std::abs(axis.pixel_max - axis.pixel_min) / pixels));
}

}  // namespace

double ChartAxis::Pixel(double value) const {
  const auto place = [this](double v) { return scale == AxisScale::kLog ? std::log(v) : v; };
  const double inside = std::clamp(value, min, max);
  const double share = (place(inside) - place(min)) / (place(max) - place(min));
  return pixel_min + share * (pixel_max - pixel_min);
}

void DrawChartFrame(const ChartAxis& x, const ChartAxis& y, Svg* svg) {
  const SvgStyle grid{.stroke = palette::kGrid};
  const SvgText label{.size = kTickSize, .fill = palette::kNote, .anchor = SvgAnchor::kMiddle};
  const double bottom = y.pixel_min;
  const bool time = x.scale == AxisScale::kTime;
  for (const Tick& tick : TicksOf(x, TickCount(x, time ? 100.0 : 80.0))) {
    const double px = x.Pixel(tick.value);
    svg->Line({px, bottom}, {px, y.pixel_max}, grid);
    if (!x.ticks) continue;
    svg->Text({px, bottom + 15.0}, tick.label, label);
    if (!tick.date.empty()) svg->Text({px, bottom + 28.0}, tick.date, label);
  }
  SvgText row_label = label;
  row_label.anchor = SvgAnchor::kEnd;
  for (const Tick& tick : y.ticks ? TicksOf(y, TickCount(y, 34.0)) : std::vector<Tick>()) {
    const double py = y.Pixel(tick.value);
    svg->Line({x.pixel_min, py}, {x.pixel_max, py}, grid);
    svg->Text({x.pixel_min - 6.0, py + 4.0}, tick.label, row_label);
  }
  svg->Rect({x.pixel_min, y.pixel_max},
            {x.pixel_max - x.pixel_min, bottom - y.pixel_max},
            {.stroke = palette::kFaint});
  if (x.ticks) {
    svg->Text({0.5 * (x.pixel_min + x.pixel_max), bottom + (time ? 42.0 : 31.0)},
              x.label,
              {.size = 12.0, .fill = palette::kText, .anchor = SvgAnchor::kMiddle});
  }
  svg->Text(
      {x.pixel_min - 44.0, y.pixel_max - 9.0}, y.label, {.size = 12.0, .fill = palette::kText});
}

void SetRange(double min, double max, ChartAxis* axis) {
  if (axis->scale == AxisScale::kLog) {
    axis->min = std::pow(10.0, std::floor(std::log10(min) + 1e-9));
    axis->max = std::pow(10.0, std::ceil(std::log10(max) - 1e-9));
    if (axis->max <= axis->min) axis->max = 10.0 * axis->min;
    return;
  }
  const double margin = max > min ? 0.04 * (max - min) : 0.5;
  axis->min = min - margin;
  axis->max = max + margin;
}

std::vector<Eigen::Vector2d> Condensed(std::span<const Eigen::Vector2d> points) {
  std::vector<Eigen::Vector2d> kept;
  for (std::size_t begin = 0; begin < points.size();) {
    std::size_t end = begin;
    std::size_t lowest = begin;
    std::size_t highest = begin;
    for (; end < points.size() && std::floor(points[end].x()) == std::floor(points[begin].x());
         ++end) {
      if (points[end].y() < points[lowest].y()) lowest = end;
      if (points[end].y() > points[highest].y()) highest = end;
    }
    std::vector<std::size_t> indices = {begin, lowest, highest, end - 1};
    std::sort(indices.begin(), indices.end());
    indices.erase(std::unique(indices.begin(), indices.end()), indices.end());
    for (const std::size_t i : indices) kept.push_back(points[i]);
    begin = end;
  }
  return kept;
}

}  // namespace shiftmap
