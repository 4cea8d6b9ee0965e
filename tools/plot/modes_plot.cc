// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/modes_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>

#include "mapstore/core/clock.h"
#include "mapstore/core/count_text.h"
#include "mapstore/core/day.h"
#include "mapstore/core/mode_name.h"
#include "mapstore/map/move_rate.h"
#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/free_network.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/palette.h"
#include "tools/plot/ticks.h"

namespace shiftmap {
namespace {

constexpr double kPanel = 190.0;
constexpr double kPanelGap = 16.0;
constexpr double kPanelCaption = 52.0;
constexpr std::size_t kPanelsPerRow = 5;
constexpr std::size_t kMostPanels = 15;
constexpr Eigen::Index kMostStates = 7;  // Of the table of rates.
constexpr double kRow = 20.0;
constexpr double kColumn = 92.0;
constexpr double kRhythm = 60.0;
constexpr double kRhythmWidth = 504.0;

// The mean time between events of a rate, to read.
std::string Every(double rate_per_s) {
  if (!(rate_per_s > 0.0)) return "never";
  const double s = 1.0 / rate_per_s;
  if (s < 120.0) return fmt::format("{:.3g} s", s);
  if (s < 2.0 * 3600.0) return fmt::format("{:.3g} min", s / 60.0);
  if (s < 2.0 * kSecondsPerDay) return fmt::format("{:.3g} h", s / 3600.0);
  return fmt::format("{:.3g} days", s / kSecondsPerDay);
}

std::string StateName(const LandmarkGroup& group, Eigen::Index state) {
  return ModeName(group.NumberOf(static_cast<int>(state)));
}

// The group alone, as a map.
MapContent Alone(const LandmarkGroup& group) {
  MapContent content;
  content.groups.push_back(group);
  return content;
}

class ModesPlot {
 public:
  ModesPlot(const MapSnapshot& map, const LandmarkGroup& group)
      : map_(map), group_(group), alone_(Alone(group)), layer_(alone_, {}) {}

  std::string Draw() const;

 private:
  std::size_t Panels() const { return std::min(group_.modes.size(), kMostPanels); }
  double PanelsHeight() const {
    const std::size_t rows = (Panels() + kPanelsPerRow - 1) / kPanelsPerRow;
    return 40.0 + static_cast<double>(rows) * (kPanel + kPanelCaption);
  }
  bool HasTable() const { return !group_.chain.uniform() && group_.chain.states() <= kMostStates; }
  double TableHeight() const {
    return 56.0 + (HasTable() ? kRow * (group_.chain.states() + 1) : kRow) + RhythmHeight();
  }
  double RhythmHeight() const { return group_.chain.rhythm() != nullptr ? kRhythm + 60.0 : 0.0; }
  // Labels are to keep clear of the arrows.
  void DrawRates(LabelPlacer* placer, Svg* svg) const;
  double LeastWidth() const;
  void DrawPanels(double top, Svg* svg) const;
  void DrawPanel(std::size_t mode, const Eigen::Vector2d& corner, Svg* svg) const;
  void DrawTable(double top, Svg* svg) const;
  void DrawRhythm(double top, Svg* svg) const;

  const MapSnapshot& map_;
  const LandmarkGroup& group_;
  MapContent alone_;
  LandmarkLayer layer_;
};

// Arrows between modes, of both directions next to each other; the wider, the higher the rate.
void ModesPlot::DrawRates(LabelPlacer* placer, Svg* svg) const {
  const Eigen::MatrixXd& rates = group_.chain.rate_matrix();
  const double largest = rates.maxCoeff();
  if (!(largest > 0.0) || layer_.many()) return;
  for (Eigen::Index from = 1; from < rates.rows(); ++from) {
    for (Eigen::Index to = 1; to < rates.cols(); ++to) {
      if (from == to || !(rates(from, to) > 0.01 * largest)) continue;
      const auto at = [&](Eigen::Index state) {
        return layer_.frame().Pixel(
            group_.modes[static_cast<std::size_t>(state) - 1].p_map_landmark);
      };
      const Eigen::Vector2d span = at(to) - at(from);
      constexpr double kClear = 12.0;
      if (span.norm() < 3.0 * kClear) continue;
      const Eigen::Vector2d along = span.normalized();
      const Eigen::Vector2d shift = 3.0 * Eigen::Vector2d(-along.y(), along.x());
      const Eigen::Vector2d start = at(from) + kClear * along + shift;
      const Eigen::Vector2d end = at(to) - kClear * along + shift;
      placer->OccupyLine(start, end, 6.0);
      svg->Arrow(start,
                 end,
                 8.0,
                 {.stroke = palette::kOrange,
                  .stroke_width = 0.8 + 1.7 * rates(from, to) / largest,
                  .opacity = 0.9});
    }
  }
}

void ModesPlot::DrawPanel(std::size_t index, const Eigen::Vector2d& corner, Svg* svg) const {
  const Mode& mode = group_.modes[index];
  const double probability = group_.probabilities(static_cast<Eigen::Index>(index) + 1);
  const Eigen::Vector2d size(kPanel, kPanel);
  const Eigen::Vector2d centre = corner + 0.5 * size;
  svg->Rect(corner, size, {.stroke = palette::kFaint});
  const ConfidenceEllipse ellipse = MakeEllipse(mode.cov_p_map_landmark);
  const double pixels_per_m = 0.38 * kPanel / std::max(1e-9, ellipse.half_axes.x());
  const Eigen::Vector2d x(0.5 * kPanel, 0.0);
  const Eigen::Vector2d y(0.0, 0.5 * kPanel);
  svg->Line(centre - x, centre + x, {.stroke = palette::kGrid});
  svg->Line(centre - y, centre + y, {.stroke = palette::kGrid});
  svg->Ellipse(centre,
               ellipse.half_axes * pixels_per_m,
               -ellipse.rotation_rad,
               {.stroke = palette::kBlue,
                .stroke_width = 1.5,
                .fill = palette::kBlue,
                .fill_opacity = 0.1 + 0.5 * probability});
  svg->Circle(centre, 2.0, {.fill = palette::kInk});
  const double bar_m = NiceStep(30.0 / pixels_per_m);
  const Eigen::Vector2d bar(corner.x() + 8.0, corner.y() + kPanel - 8.0);
  svg->Line(bar,
            bar + Eigen::Vector2d(bar_m * pixels_per_m, 0.0),
            {.stroke = palette::kInk, .stroke_width = 2.0});
  const auto length = [](double m) {
    return m < 0.0995 ? fmt::format("{:.3g} mm", 1000.0 * m) : fmt::format("{:.3g} m", m);
  };
  svg->Text(bar + Eigen::Vector2d(bar_m * pixels_per_m + 5.0, 3.0),
            length(bar_m),
            {.size = 10.0, .halo = true});
  svg->Text(corner + Eigen::Vector2d(0.0, kPanel + 15.0),
            fmt::format("mode {}: {}", mode.number.value(), PercentText(probability)),
            {.size = 12.0, .bold = true});
  const Eigen::Vector2d sd = mode.cov_p_map_landmark.diagonal().cwiseSqrt();
  svg->Text(corner + Eigen::Vector2d(0.0, kPanel + 29.0),
            fmt::format("sd {} in x, {} in y", length(sd.x()), length(sd.y())),
            {.size = 10.0, .fill = palette::kNote});
  svg->Text(corner + Eigen::Vector2d(0.0, kPanel + 42.0),
            mode.last_seen == Stamp() ? std::string("surveyed")
                                      : "last mapped " + FormatUtc(mode.last_seen).substr(0, 16),
            {.size = 10.0, .fill = palette::kNote});
}

void ModesPlot::DrawPanels(double top, Svg* svg) const {
  const double left = layer_.frame().corner().x();
  const bool all = Panels() == group_.modes.size();
  svg->Text(
      {left, top + 20.0},
      all ? std::string("Each mode by itself: 95 % of its position (2.45 sigma) to the others")
          : fmt::format("The first {} modes by themselves: 95 % of the position (2.45 sigma) "
                        "to the others",
                        Panels()),
      {.size = 13.0, .bold = true});
  for (std::size_t i = 0; i < Panels(); ++i) {
    const std::size_t row = i / kPanelsPerRow;
    const std::size_t column = i % kPanelsPerRow;
    const Eigen::Vector2d corner(left + static_cast<double>(column) * (kPanel + kPanelGap),
                                 top + 32.0 + static_cast<double>(row) * (kPanel + kPanelCaption));
    DrawPanel(i, corner, svg);
  }
}

void ModesPlot::DrawTable(double top, Svg* svg) const {
  const double left = layer_.frame().corner().x();
  const ModeChain& chain = group_.chain;
  svg->Text({left, top + 20.0}, "Rates of the mode chain [1/s]", {.size = 13.0, .bold = true});
  const SvgText note{.size = 12.0, .fill = palette::kText};
  if (!HasTable()) {
    svg->Text({left, top + 42.0},
              fmt::format("{} at {:.2g} per s, once in {}{}",
                          chain.uniform() ? "leaves every state" : "moves, in the long run,",
                          MoveRate(chain),
                          Every(MoveRate(chain)),
                          chain.uniform() ? ", and goes to all others alike" : ""),
              note);
    return;
  }
  SvgText head = note;
  head.bold = true;
  head.anchor = SvgAnchor::kEnd;
  SvgText cell = note;
  cell.anchor = SvgAnchor::kEnd;
  svg->Text({left, top + 42.0}, "from \\ to", note);
  for (Eigen::Index to = 0; to < chain.states(); ++to) {
    svg->Text(
        {left + kColumn * static_cast<double>(to + 2), top + 42.0}, StateName(group_, to), head);
  }
  for (Eigen::Index from = 0; from < chain.states(); ++from) {
    const double y = top + 42.0 + kRow * static_cast<double>(from + 1);
    svg->Text({left, y}, StateName(group_, from), {.size = 12.0, .bold = true});
    for (Eigen::Index to = 0; to < chain.states(); ++to) {
      if (from == to) continue;
      svg->Text({left + kColumn * static_cast<double>(to + 2), y},
                fmt::format("{:.2g}", chain.rate_matrix()(from, to)),
                cell);
    }
    svg->Text({left + kColumn * static_cast<double>(chain.states() + 1) + 20.0, y},
              "left once in " + Every(-chain.rate_matrix()(from, from)),
              {.size = 11.0, .fill = palette::kNote});
  }
}

// A bar for each part of the day or of the week, as high as the mean rate of leaving a state then.
void ModesPlot::DrawRhythm(double top, Svg* svg) const {
  const ChainRhythm* const rhythm = group_.chain.rhythm();
  if (rhythm == nullptr) return;
  const double left = layer_.frame().corner().x();
  const bool week = rhythm->calendar().period == kRhythmWeek;
  std::vector<double> rates;
  for (const Eigen::MatrixXd& matrix : rhythm->rate_matrices()) {
    rates.push_back(-matrix.diagonal().mean());
  }
  const double largest = *std::max_element(rates.begin(), rates.end());
  svg->Text({left, top + 14.0},
            fmt::format("Rate of leaving a state by the hour of the {}, UTC; highest {:.2g} per s",
                        week ? "week, from Monday" : "day",
                        largest),
            {.size = 12.0, .bold = true});
  const double base = top + 24.0 + kRhythm;
  const double width = kRhythmWidth / static_cast<double>(rates.size());
  for (std::size_t i = 0; i < rates.size(); ++i) {
    const double height = largest > 0.0 ? kRhythm * rates[i] / largest : 0.0;
    svg->Rect({left + width * static_cast<double>(i), base - height},
              {0.85 * width, height},
              {.fill = palette::kOrange});
  }
  const int ticks = week ? 7 : 4;
  constexpr std::array<const char*, 7> kDays = {"Mon", "Tue", "Wed", "Thu", "Fri", "Sat", "Sun"};
  for (int i = 0; i < ticks; ++i) {
    svg->Text({left + kRhythmWidth * i / ticks, base + 14.0},
              week ? std::string(kDays[static_cast<std::size_t>(i)]) : fmt::format("{} h", 6 * i),
              {.size = 11.0, .fill = palette::kNote});
  }
}

double ModesPlot::LeastWidth() const {
  const std::size_t panels = std::min(Panels(), kPanelsPerRow);
  const double row = static_cast<double>(panels) * (kPanel + kPanelGap);
  const double table = HasTable() ? kColumn * (group_.chain.states() + 1) + 180.0 : 560.0;
  return layer_.frame().corner().x() + std::max(row, table) + 12.0;
}

std::string ModesPlot::Draw() const {
  Legend legend;
  layer_.AddTo(&legend);
  legend.Entry(
      [](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Arrow(at - half, at + half, 7.0, {.stroke = palette::kOrange, .stroke_width = 2.0});
      },
      "moves of the chain, the wider the more often");
  legend.Note(fmt::format("absent: {}", PercentText(group_.probabilities(0))));
  Svg svg =
      StartMapPage({.title = fmt::format("{} · {} · version {}",
                                         Svg::Shortened(group_.signature.text(), 18.0, 400.0, true),
                                         map_.area(),
                                         map_.version().value()),
                    .subtitle = fmt::format("probabilities at {} UTC · {}",
                                            FormatUtc(map_.stamp()),
                                            CountText(group_.modes.size(), "mode")),
                    .below = PanelsHeight() + TableHeight(),
                    .least_width = LeastWidth()},
                   layer_.frame(),
                   legend);
  LabelPlacer placer = layer_.MakePlacer();
  DrawRates(&placer, &svg);
  layer_.Draw(1.0, &svg);
  layer_.DrawLabels(std::move(placer), &svg);
  const double top = BelowMap(layer_.frame(), legend);
  DrawPanels(top, &svg);
  DrawTable(top + PanelsHeight(), &svg);
  DrawRhythm(top + PanelsHeight() + TableHeight() - RhythmHeight(), &svg);
  return svg.ToString();
}

}  // namespace

std::string PlotModes(const MapSnapshot& map, const LandmarkGroup& group) {
  const FreeMap free = FreeNetwork(map.content());
  const auto index = static_cast<std::size_t>(map.GroupIndex(group.signature));
  return ModesPlot(map, free.content.groups[index]).Draw();
}

}  // namespace shiftmap
