// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/map_plot.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "mapstore/core/clock.h"
#include "tools/plot/confidence_ellipse.h"
#include "tools/plot/label_placer.h"
#include "tools/plot/svg.h"

namespace shiftmap {
namespace {

constexpr double kMargin = 56.0;
constexpr double kHeader = 64.0;
constexpr double kLegendWidth = 230.0;
constexpr double kPlotSize = 760.0;  // Of the longer side.
constexpr double kMarkerRadius = 4.5;
constexpr double kLabelSize = 11.0;
constexpr std::size_t kRunsInLegend = 12;

// Okabe and Ito's colours. The marks of the map use blue, which no trajectory has.
constexpr const char* kModeColor = "#0072B2";
constexpr const char* kRunColors[] = {
    "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#B8AA00", "#7A7A7A"};

const char* RunColor(std::size_t run) { return kRunColors[run % std::size(kRunColors)]; }

Eigen::Index MostProbable(const LandmarkGroup& group) {
  Eigen::Index state = 0;
  group.probabilities.maxCoeff(&state);
  return state;
}

// 1, 2 or 5 times a power of ten, at least `value`.
double NiceStep(double value) {
  const double power = std::pow(10.0, std::floor(std::log10(value)));
  for (const double factor : {1.0, 2.0, 5.0}) {
    if (factor * power >= value) return factor * power;
  }
  return 10.0 * power;
}

class MapPlot {
 public:
  MapPlot(const MapSnapshot& snapshot, const Provenance& provenance)
      : snapshot_(snapshot), provenance_(provenance) {
    FindBounds();
  }

  std::string Draw();

 private:
  void FindBounds();
  Eigen::Vector2d Pixel(const Eigen::Vector2d& p_map) const {
    return {kMargin + (p_map.x() - min_.x()) * pixels_per_m_,
            kHeader + (max_.y() - p_map.y()) * pixels_per_m_};
  }
  void DrawFrame(Svg* svg) const;
  void DrawTrajectories(Svg* svg) const;
  void DrawEllipse(const Mode& mode, bool filled, Svg* svg) const;
  void DrawGroup(const LandmarkGroup& group, Svg* svg) const;
  void DrawAnonymous(Svg* svg) const;
  void DrawLabels(Svg* svg) const;
  void DrawLegend(Svg* svg) const;
  void DrawScaleBar(Svg* svg) const;

  const MapSnapshot& snapshot_;
  const Provenance& provenance_;
  Eigen::Vector2d min_ = Eigen::Vector2d::Zero();
  Eigen::Vector2d max_ = Eigen::Vector2d::Zero();
  double pixels_per_m_ = 1.0;
  Eigen::Vector2d plot_size_ = Eigen::Vector2d::Zero();
};

void MapPlot::FindBounds() {
  std::vector<Eigen::Vector2d> points;
  const auto add_mode = [&](const Mode& mode) {
    const Eigen::Vector2d half =
        Eigen::Vector2d::Constant(MakeEllipse(mode.cov_p_map_landmark).half_axes.x());
    points.push_back(mode.p_map_landmark - half);
    points.push_back(mode.p_map_landmark + half);
  };
  for (const LandmarkGroup& group : snapshot_.groups()) {
    for (const Mode& mode : group.modes) add_mode(mode);
  }
  for (const Mode& mode : snapshot_.anonymous_landmarks()) add_mode(mode);
  for (const RunRecord& run : provenance_.runs) {
    for (const TrajectoryPose& pose : run.trajectory) {
      points.push_back(pose.T_map_vehicle.translation());
    }
  }
  if (points.empty()) points.emplace_back(0.0, 0.0);
  min_ = max_ = points.front();
  for (const Eigen::Vector2d& p : points) {
    min_ = min_.cwiseMin(p);
    max_ = max_.cwiseMax(p);
  }
  const double edge = std::max(0.5, 0.05 * (max_ - min_).maxCoeff());
  min_.array() -= edge;
  max_.array() += edge;
  pixels_per_m_ = kPlotSize / (max_ - min_).maxCoeff();
  // A corridor must leave room for the legend beside it.
  constexpr double kLeastHeight = 420.0;
  const double missing = kLeastHeight / pixels_per_m_ - (max_.y() - min_.y());
  if (missing > 0.0) {
    min_.y() -= 0.5 * missing;
    max_.y() += 0.5 * missing;
  }
  plot_size_ = (max_ - min_) * pixels_per_m_;
}

void MapPlot::DrawFrame(Svg* svg) const {
  const SvgStyle grid{.stroke = "#e4e4e4", .stroke_width = 1.0};
  const SvgText label{.size = 11.0, .fill = "#666666", .anchor = SvgAnchor::kMiddle};
  SvgText row_label = label;
  row_label.anchor = SvgAnchor::kEnd;
  const double step = NiceStep(80.0 / pixels_per_m_);
  const double bottom = kHeader + plot_size_.y();
  for (double x = std::ceil(min_.x() / step) * step; x <= max_.x(); x += step) {
    const double px = Pixel({x, min_.y()}).x();
    svg->Line({px, kHeader}, {px, bottom}, grid);
    svg->Text({px, bottom + 16.0}, fmt::format("{:.4g}", x + 0.0), label);
  }
  for (double y = std::ceil(min_.y() / step) * step; y <= max_.y(); y += step) {
    const double py = Pixel({min_.x(), y}).y();
    svg->Line({kMargin, py}, {kMargin + plot_size_.x(), py}, grid);
    svg->Text({kMargin - 6.0, py + 4.0}, fmt::format("{:.4g}", y + 0.0), row_label);
  }
  svg->Rect({kMargin, kHeader}, plot_size_, {.stroke = "#999999"});
  svg->Text({kMargin + 0.5 * plot_size_.x(), bottom + 34.0}, "x / m", label);
  svg->Text({kMargin - 6.0, kHeader - 8.0}, "y / m", row_label);
}

void MapPlot::DrawTrajectories(Svg* svg) const {
  for (std::size_t r = 0; r < provenance_.runs.size(); ++r) {
    std::vector<Eigen::Vector2d> points;
    for (const TrajectoryPose& pose : provenance_.runs[r].trajectory) {
      points.push_back(Pixel(pose.T_map_vehicle.translation()));
    }
    if (points.empty()) continue;
    svg->Polyline(points, {.stroke = RunColor(r), .stroke_width = 1.3, .opacity = 0.65});
  }
}

void MapPlot::DrawEllipse(const Mode& mode, bool filled, Svg* svg) const {
  const ConfidenceEllipse ellipse = MakeEllipse(mode.cov_p_map_landmark);
  const Eigen::Vector2d at = Pixel(mode.p_map_landmark);
  const Eigen::Vector2d half_axes = ellipse.half_axes * pixels_per_m_;
  if (filled)
    svg->Ellipse(at, half_axes, -ellipse.rotation_rad, {.fill = kModeColor, .opacity = 0.18});
  svg->Ellipse(at,
               half_axes,
               -ellipse.rotation_rad,
               {.stroke = kModeColor, .stroke_width = 1.0, .opacity = filled ? 0.9 : 0.55});
}

void MapPlot::DrawGroup(const LandmarkGroup& group, Svg* svg) const {
  const Eigen::Index best = MostProbable(group);
  const std::size_t hub = best > 0 ? static_cast<std::size_t>(best - 1) : 0;
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    if (i == hub) continue;
    svg->Line(Pixel(group.modes[hub].p_map_landmark),
              Pixel(group.modes[i].p_map_landmark),
              {.stroke = "#777777", .stroke_width = 1.0, .opacity = 0.45, .dash = "4 4"});
  }
  for (std::size_t i = 0; i < group.modes.size(); ++i) {
    const Mode& mode = group.modes[i];
    const auto state = static_cast<Eigen::Index>(i + 1);
    DrawEllipse(mode, state == best, svg);
    svg->Circle(
        Pixel(mode.p_map_landmark),
        kMarkerRadius,
        {.stroke = kModeColor, .stroke_width = 1.6, .fill = state == best ? kModeColor : "#ffffff"},
        fmt::format("{} mode {}: ({:.2f}, {:.2f}) m, probability {:.3f}",
                    group.signature.text(),
                    mode.number.value(),
                    mode.p_map_landmark.x(),
                    mode.p_map_landmark.y(),
                    group.probabilities(state)));
  }
}

void MapPlot::DrawAnonymous(Svg* svg) const {
  for (const Mode& mode : snapshot_.anonymous_landmarks()) {
    const Eigen::Vector2d at = Pixel(mode.p_map_landmark);
    const SvgStyle cross{.stroke = "#444444", .stroke_width = 1.2};
    svg->Line(at - Eigen::Vector2d(3.0, 0.0), at + Eigen::Vector2d(3.0, 0.0), cross);
    svg->Line(at - Eigen::Vector2d(0.0, 3.0), at + Eigen::Vector2d(0.0, 3.0), cross);
  }
}

void MapPlot::DrawLabels(Svg* svg) const {
  LabelPlacer placer;
  for (const LandmarkGroup& group : snapshot_.groups()) {
    for (const Mode& mode : group.modes) placer.Occupy(Pixel(mode.p_map_landmark), kMarkerRadius);
  }
  // The most probable modes choose first: their labels are never left out.
  for (const bool best_modes : {true, false}) {
    for (const LandmarkGroup& group : snapshot_.groups()) {
      const Eigen::Index best = std::max<Eigen::Index>(1, MostProbable(group));
      for (std::size_t i = 0; i < group.modes.size(); ++i) {
        if ((static_cast<Eigen::Index>(i + 1) == best) != best_modes) continue;
        const double size = best_modes ? kLabelSize : kLabelSize - 1.5;
        const bool absent = best_modes && MostProbable(group) == 0;
        const std::string text = group.signature.text() + (absent ? " (absent)" : "");
        const Eigen::Vector2d point = Pixel(group.modes[i].p_map_landmark);
        const auto at = placer.Place(
            point, kMarkerRadius + 2.0, {Svg::TextWidth(text, size), 0.9 * size}, best_modes);
        if (!at) continue;
        svg->Text(*at,
                  text,
                  {.size = size,
                   .fill = best_modes ? "#111111" : "#777777",
                   .bold = best_modes,
                   .halo = true});
      }
    }
  }
}

void MapPlot::DrawLegend(Svg* svg) const {
  const double x = kMargin + plot_size_.x() + 24.0;
  double y = kHeader + 12.0;
  const SvgText text{.size = 12.0};
  const auto entry = [&](const std::string& label) {
    svg->Text({x + 24.0, y + 4.0}, label, text);
    y += 22.0;
  };
  svg->Ellipse({x + 8.0, y}, {9.0, 6.5}, 0.0, {.fill = kModeColor, .opacity = 0.18});
  svg->Circle({x + 8.0, y}, kMarkerRadius, {.stroke = kModeColor, .fill = kModeColor});
  entry("most probable mode");
  svg->Circle(
      {x + 8.0, y}, kMarkerRadius, {.stroke = kModeColor, .stroke_width = 1.6, .fill = "#ffffff"});
  entry("other mode");
  svg->Ellipse({x + 8.0, y}, {9.0, 6.0}, 0.0, {.stroke = kModeColor});
  entry("95 % of its position");
  svg->Line({x - 2.0, y},
            {x + 18.0, y},
            {.stroke = "#777777", .stroke_width = 1.2, .opacity = 0.7, .dash = "4 4"});
  entry("same landmark");
  if (!snapshot_.anonymous_landmarks().empty()) {
    svg->Line({x + 5.0, y}, {x + 11.0, y}, {.stroke = "#444444", .stroke_width = 1.2});
    svg->Line({x + 8.0, y - 3.0}, {x + 8.0, y + 3.0}, {.stroke = "#444444", .stroke_width = 1.2});
    entry("landmark without signature");
  }
  y += 8.0;
  const std::size_t runs = provenance_.runs.size();
  for (std::size_t r = 0; r < std::min(runs, kRunsInLegend); ++r) {
    svg->Line({x - 2.0, y}, {x + 18.0, y}, {.stroke = RunColor(r), .stroke_width = 2.0});
    entry(provenance_.runs[r].name);
  }
  if (runs > kRunsInLegend) entry(fmt::format("and {} more runs", runs - kRunsInLegend));
}

void MapPlot::DrawScaleBar(Svg* svg) const {
  const double length_m = NiceStep(60.0 / pixels_per_m_);
  const double length = length_m * pixels_per_m_;
  const double right = kMargin + plot_size_.x() + 24.0 + length;
  const double y = kHeader + plot_size_.y() - 6.0;
  const SvgStyle bar{.stroke = "#222222", .stroke_width = 2.0};
  svg->Line({right - length, y}, {right, y}, bar);
  svg->Line({right - length, y - 5.0}, {right - length, y + 5.0}, bar);
  svg->Line({right, y - 5.0}, {right, y + 5.0}, bar);
  svg->Text({right - 0.5 * length, y - 8.0},
            fmt::format("{:g} m", length_m),
            {.size = 12.0, .anchor = SvgAnchor::kMiddle});
}

std::string MapPlot::Draw() {
  Svg svg(kMargin + plot_size_.x() + 24.0 + kLegendWidth, kHeader + plot_size_.y() + kMargin);
  svg.Text({kMargin, 26.0},
           fmt::format("{} · version {}", snapshot_.area(), snapshot_.version().value()),
           {.size = 18.0, .bold = true});
  svg.Text({kMargin + 1.0, 46.0},
           fmt::format("probabilities at {} UTC · {} landmarks, {} modes",
                       FormatUtc(snapshot_.stamp()),
                       snapshot_.groups().size(),
                       snapshot_.covariance().size()),
           {.size = 12.0, .fill = "#555555"});
  DrawFrame(&svg);
  DrawTrajectories(&svg);
  DrawAnonymous(&svg);
  for (const LandmarkGroup& group : snapshot_.groups()) DrawGroup(group, &svg);
  DrawLabels(&svg);
  DrawLegend(&svg);
  DrawScaleBar(&svg);
  return svg.ToString();
}

}  // namespace

std::string PlotMap(const MapSnapshot& snapshot, const Provenance& provenance) {
  return MapPlot(snapshot, provenance).Draw();
}

}  // namespace shiftmap
