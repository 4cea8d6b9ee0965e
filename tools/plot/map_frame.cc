// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/map_frame.h"

#include <fmt/format.h>

#include <algorithm>

#include "tools/plot/palette.h"
#include "tools/plot/ticks.h"

namespace shiftmap {
namespace {

constexpr double kHeader = 64.0;
constexpr double kFooter = 44.0;
constexpr double kColumnGap = 22.0;
constexpr double kEdge = 12.0;
constexpr double kPlotSize = 760.0;   // Of the longer side.
constexpr double kLeastSize = 240.0;  // A corridor is not a line.
constexpr double kScaleBarHeight = 44.0;
constexpr double kTickSize = 11.0;
constexpr double kFarthest_m = 1e12;

Eigen::Vector2d Bounded(const Eigen::Vector2d& p) {
  return p.cwiseMax(-kFarthest_m).cwiseMin(kFarthest_m);
}

// Of a point from the line between two others.
double DistanceToLine(const Eigen::Vector2d& p,
                      const Eigen::Vector2d& from,
                      const Eigen::Vector2d& to) {
  const Eigen::Vector2d line = to - from;
  const double length = line.squaredNorm();
  const double share = length > 0.0 ? std::clamp((p - from).dot(line) / length, 0.0, 1.0) : 0.0;
  return (p - from - share * line).norm();
}

}  // namespace

MapFrame MapFrame::Around(std::span<const Eigen::Vector2d> points) {
  MapFrame frame;
  if (!points.empty()) frame.min_ = frame.max_ = Bounded(points.front());
  for (const Eigen::Vector2d& p : points) {
    frame.min_ = frame.min_.cwiseMin(Bounded(p));
    frame.max_ = frame.max_.cwiseMax(Bounded(p));
  }
  const double span = (frame.max_ - frame.min_).maxCoeff();
  frame.max_.array() += std::max(0.25, 0.03 * span);
  frame.min_.array() -= std::max(0.25, 0.03 * span);
  frame.pixels_per_m_ = kPlotSize / (frame.max_ - frame.min_).maxCoeff();
  const Eigen::Vector2d missing =
      (kLeastSize / frame.pixels_per_m_ - (frame.max_ - frame.min_).array()).max(0.0);
  frame.min_ -= 0.5 * missing;
  frame.max_ += 0.5 * missing;
  frame.size_ = (frame.max_ - frame.min_) * frame.pixels_per_m_;
  frame.step_m_ = NiceStep(80.0 / frame.pixels_per_m_);
  double label = 0.0;
  for (const double y : {frame.min_.y(), frame.max_.y()}) {
    label = std::max(label, Svg::TextWidth(LinearLabel(y, frame.step_m_), kTickSize));
  }
  frame.corner_ = {std::max(48.0, label + 20.0), kHeader + 12.0};
  return frame;
}

Eigen::Vector2d MapFrame::Pixel(const Eigen::Vector2d& p_map) const {
  const Eigen::Vector2d p = Bounded(p_map);
  return corner_ + Eigen::Vector2d(p.x() - min_.x(), max_.y() - p.y()) * pixels_per_m_;
}

void MapFrame::DrawAxes(Svg* svg) const {
  const SvgStyle grid{.stroke = palette::kGrid};
  const SvgText label{.size = kTickSize, .fill = palette::kNote, .anchor = SvgAnchor::kMiddle};
  SvgText row_label = label;
  row_label.anchor = SvgAnchor::kEnd;
  const Eigen::Vector2d end = corner_ + size_;
  for (const double x : Multiples(min_.x(), max_.x(), step_m_)) {
    const double px = Pixel({x, min_.y()}).x();
    svg->Line({px, corner_.y()}, {px, end.y()}, grid);
    svg->Text({px, end.y() + 15.0}, LinearLabel(x, step_m_), label);
  }
  for (const double y : Multiples(min_.y(), max_.y(), step_m_)) {
    const double py = Pixel({min_.x(), y}).y();
    svg->Line({corner_.x(), py}, {end.x(), py}, grid);
    svg->Text({corner_.x() - 6.0, py + 4.0}, LinearLabel(y, step_m_), row_label);
  }
  svg->Rect(corner_, size_, {.stroke = palette::kFaint});
  const SvgText name{.size = 12.0, .fill = palette::kText};
  SvgText middle = name;
  middle.anchor = SvgAnchor::kMiddle;
  svg->Text({corner_.x() + 0.5 * size_.x(), end.y() + 32.0}, "x [m], map frame", middle);
  svg->Text({corner_.x() - 36.0, corner_.y() - 8.0}, "y [m]", name);
}

void MapFrame::DrawScaleBar(const Eigen::Vector2d& left, Svg* svg) const {
  const double length_m = NiceStep(60.0 / pixels_per_m_);
  const Eigen::Vector2d right = left + Eigen::Vector2d(length_m * pixels_per_m_, 0.0);
  const SvgStyle bar{.stroke = palette::kInk, .stroke_width = 2.0};
  const Eigen::Vector2d cap(0.0, 4.0);
  svg->Line(left, right, bar);
  svg->Line(left - cap, left + cap, bar);
  svg->Line(right - cap, right + cap, bar);
  svg->Text(right + Eigen::Vector2d(8.0, 4.0), fmt::format("{:g} m", length_m), {.size = 12.0});
}

double BelowMap(const MapFrame& frame, const Legend& legend) {
  const double column = frame.corner().y() + legend.height() + kScaleBarHeight;
  return std::max(frame.corner().y() + frame.size().y() + kFooter, column + kEdge);
}

Svg StartMapPage(const MapPage& page, const MapFrame& frame, const Legend& legend) {
  const double column = frame.corner().x() + frame.size().x() + kColumnGap;
  const double width = std::max(page.least_width, column + Legend::kWidth + kEdge);
  Svg svg(width, BelowMap(frame, legend) + page.below);
  DrawTitles(page.title, page.subtitle, kEdge, width - 2.0 * kEdge, &svg);
  frame.DrawAxes(&svg);
  legend.Draw({column, frame.corner().y()}, &svg);
  const double bar_y = std::max(frame.corner().y() + frame.size().y() - 8.0,
                                frame.corner().y() + legend.height() + 0.7 * kScaleBarHeight);
  frame.DrawScaleBar({column + 2.0, bar_y}, &svg);
  return svg;
}

std::vector<Eigen::Vector2d> Thinned(std::span<const Eigen::Vector2d> points, double tolerance) {
  if (points.empty()) return {};
  std::vector<bool> kept(points.size(), false);
  kept.front() = kept.back() = true;
  std::vector<std::pair<std::size_t, std::size_t>> open = {{0, points.size() - 1}};
  while (!open.empty()) {
    const auto [first, last] = open.back();
    open.pop_back();
    double farthest = tolerance;
    std::size_t split = first;
    for (std::size_t i = first + 1; i < last; ++i) {
      const double distance = DistanceToLine(points[i], points[first], points[last]);
      if (distance <= farthest) continue;
      farthest = distance;
      split = i;
    }
    if (split == first) continue;
    kept[split] = true;
    open.emplace_back(first, split);
    open.emplace_back(split, last);
  }
  std::vector<Eigen::Vector2d> thinned;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (kept[i]) thinned.push_back(points[i]);
  }
  return thinned;
}

}  // namespace shiftmap
