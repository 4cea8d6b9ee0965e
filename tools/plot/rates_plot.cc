// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/rates_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <tuple>

#include "mapstore/core/count_text.h"
#include "tools/plot/chart_frame.h"
#include "tools/plot/legend.h"
#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr double kEdge = 12.0;
constexpr double kTop = 92.0;
constexpr double kWidth = 560.0;
constexpr double kNames = 130.0;
constexpr double kVisits = 64.0;
constexpr double kRow = 18.0;
constexpr double kBottom = 62.0;
constexpr std::size_t kNamedRows = 150;
constexpr double kTallest = 1000.0;  // Of the chart with thin rows.
constexpr double kLeastRate = 1e-15;

struct NamedRate {
  Signature signature;
  MoveRateEstimate rate;
};

void DrawRate(
    const MoveRateEstimate& rate, double y, double size, const ChartAxis& axis, Svg* svg) {
  if (!(rate.rate_per_s > kLeastRate)) return;
  const SvgStyle bar{.stroke = palette::kBlue, .stroke_width = size, .opacity = 0.45};
  svg->Line({axis.Pixel(rate.low_per_s), y}, {axis.Pixel(rate.high_per_s), y}, bar);
  svg->Circle({axis.Pixel(rate.rate_per_s), y}, size, {.fill = palette::kBlue});
}

ChartAxis RateAxis(const std::vector<NamedRate>& rates) {
  double low = 1e300;
  double high = 0.0;
  for (const auto& [signature, rate] : rates) {
    for (const double value : {rate.low_per_s, rate.high_per_s}) {
      if (!(value > kLeastRate)) continue;
      low = std::min(low, value);
      high = std::max(high, value);
    }
  }
  ChartAxis axis{.label = "move rate [1/s]",
                 .scale = AxisScale::kLog,
                 .pixel_min = kEdge + kNames,
                 .pixel_max = kEdge + kNames + kWidth};
  SetRange(high > 0.0 ? low : 1e-6, high > 0.0 ? high : 1e-4, &axis);
  return axis;
}

// Marks of the same rates in units that people think in, above the axis.
void DrawPeriods(const ChartAxis& axis, Svg* svg) {
  struct Period {
    double s;
    const char* text;
  };
  constexpr Period kPeriods[] = {{60.0, "1 min"},
                                 {3600.0, "1 h"},
                                 {86400.0, "1 day"},
                                 {604800.0, "1 week"},
                                 {2629800.0, "1 month"},
                                 {31557600.0, "1 year"}};
  double last = 1e9;
  for (const Period& period : kPeriods) {
    const double rate = 1.0 / period.s;
    if (rate <= axis.min || rate >= axis.max) continue;
    const double x = axis.Pixel(rate);
    svg->Line({x, kTop - 5.0}, {x, kTop}, {.stroke = palette::kFaint});
    if (x > last - 54.0) continue;
    last = x;
    svg->Text({x, kTop - 8.0},
              period.text,
              {.size = 10.0, .fill = palette::kNote, .anchor = SvgAnchor::kMiddle});
  }
  svg->Text({axis.pixel_min - 8.0, kTop - 8.0},
            "once in",
            {.size = 10.0, .fill = palette::kNote, .anchor = SvgAnchor::kEnd});
}

void DrawNamedRows(const std::vector<NamedRate>& rates, const ChartAxis& axis, Svg* svg) {
  const double visits_x = axis.pixel_max + kVisits - 8.0;
  svg->Text({visits_x, kTop - 8.0},
            "visits",
            {.size = 11.0, .fill = palette::kText, .anchor = SvgAnchor::kEnd});
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const double y = kTop + kRow * (static_cast<double>(i) + 0.5);
    svg->Line({axis.pixel_min, y}, {axis.pixel_max, y}, {.stroke = palette::kGrid});
    svg->Text({axis.pixel_min - 8.0, y + 4.0},
              Svg::Shortened(rates[i].signature.text(), 11.0, kNames - 10.0),
              {.size = 11.0, .fill = palette::kInk, .anchor = SvgAnchor::kEnd});
    svg->Text({visits_x, y + 4.0},
              fmt::format("{}", rates[i].rate.visits),
              {.size = 11.0, .fill = palette::kText, .anchor = SvgAnchor::kEnd});
    DrawRate(rates[i].rate, y, 3.5, axis, svg);
  }
}

void DrawThinRows(const std::vector<NamedRate>& rates,
                  double row,
                  const ChartAxis& axis,
                  Svg* svg) {
  std::vector<Eigen::Vector2d> intervals;
  std::vector<Eigen::Vector2d> dots;
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const double y = kTop + row * (static_cast<double>(i) + 0.5);
    const MoveRateEstimate& rate = rates[i].rate;
    if (!(rate.rate_per_s > kLeastRate)) continue;
    intervals.emplace_back(axis.Pixel(rate.low_per_s), y);
    intervals.emplace_back(axis.Pixel(rate.high_per_s), y);
    dots.emplace_back(axis.Pixel(rate.rate_per_s), y);
  }
  const double size = std::clamp(0.4 * row, 0.5, 2.0);
  svg->Segments(intervals,
                {.stroke = palette::kBlue, .stroke_width = std::min(row, 2.0), .opacity = 0.25});
  svg->Dots(dots, size, palette::kBlue);
}

}  // namespace

std::string PlotRates(const MapSnapshot& map, const MoveRates& by_signature) {
  std::vector<NamedRate> rates;
  for (const auto& [signature, rate] : by_signature) rates.push_back({signature, rate});
  std::sort(rates.begin(), rates.end(), [](const NamedRate& a, const NamedRate& b) {
    return std::tie(b.rate.rate_per_s, a.signature) < std::tie(a.rate.rate_per_s, b.signature);
  });
  const bool named = rates.size() <= kNamedRows;
  const auto count = static_cast<double>(std::max<std::size_t>(rates.size(), 1));
  const double row = named ? kRow : std::min(6.0, kTallest / count);
  const double height = std::max(120.0, row * count);
  const ChartAxis x = RateAxis(rates);
  const ChartAxis y{
      .min = 0.0, .max = 1.0, .pixel_min = kTop + height, .pixel_max = kTop, .ticks = false};
  Legend legend;
  legend.Heading("Moves in the long run");
  legend.Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Line(
            at - half, at + half, {.stroke = palette::kBlue, .stroke_width = 3.5, .opacity = 0.45});
        svg->Circle(at, 3.5, {.fill = palette::kBlue});
      },
      "of the map, with the 95 % interval that its visits leave");
  legend.Note("Landmarks share a prior: one with few visits gets the rate that is usual here.");
  if (!named) {
    legend.Note(
        fmt::format("Rows are landmarks by their rate; {} are too many for names.", rates.size()));
  }
  const double column = x.pixel_max + (named ? kVisits : 0.0) + 22.0;
  const double width = column + Legend::kWidth + kEdge;
  Svg svg(width, kTop + std::max(height, legend.height()) + kBottom);
  std::int64_t visits = 0;
  for (const auto& [signature, rate] : rates) visits += rate.visits;
  DrawTitles(
      fmt::format("{} · version {} · move rates", map.area(), map.version().value()),
      fmt::format("{} · {}", CountText(rates.size(), "landmark"), CountText(visits, "visit")),
      kEdge,
      width - 2.0 * kEdge,
      &svg);
  DrawChartFrame(x, y, &svg);
  DrawPeriods(x, &svg);
  if (named) {
    DrawNamedRows(rates, x, &svg);
  } else {
    DrawThinRows(rates, row, x, &svg);
  }
  legend.Draw({column, kTop}, &svg);
  return svg.ToString();
}

}  // namespace shiftmap
