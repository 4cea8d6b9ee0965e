// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/run_layer.h"

#include <fmt/format.h>

#include <algorithm>

#include "mapstore/core/clock.h"
#include "tools/plot/palette.h"

namespace shiftmap {
namespace {

constexpr std::size_t kColored = palette::kRuns.size();
constexpr const char* kEarlier = "#B5B5B5";
// Off by half a pixel, and more where there are more points than these.
constexpr double kTolerance = 0.5;
constexpr std::size_t kMostPoints = 40'000;

// Index of the first run that has a colour.
std::size_t FirstColored(const std::vector<RunRecord>& runs) {
  return runs.size() > kColored ? runs.size() - kColored : 0;
}

Legend::Symbol LineSymbol(const char* color) {
  return [color](const Eigen::Vector2d& at, Svg* svg) {
    svg->Line(at - Eigen::Vector2d(10.0, 0.0),
              at + Eigen::Vector2d(10.0, 0.0),
              {.stroke = color, .stroke_width = 2.0});
  };
}

}  // namespace

void AppendPositions(const std::vector<StampedPose>& trajectory,
                     std::vector<Eigen::Vector2d>* points) {
  for (const StampedPose& pose : trajectory) {
    points->emplace_back(pose.T_map_vehicle.translation());
  }
}

void DrawTrajectory(const std::vector<StampedPose>& trajectory,
                    const MapFrame& frame,
                    const SvgStyle& style,
                    double tolerance,
                    Svg* svg) {
  std::vector<Eigen::Vector2d> points;
  AppendPositions(trajectory, &points);
  for (Eigen::Vector2d& p : points) p = frame.Pixel(p);
  points = Thinned(points, tolerance);
  if (points.size() > 1) svg->Polyline(points, style);
}

std::vector<Eigen::Vector2d> RunLayer::Positions() const {
  std::vector<Eigen::Vector2d> points;
  for (const std::vector<RunRecord>* runs : {&earlier_, &runs_}) {
    for (const RunRecord& run : *runs) AppendPositions(run.trajectory, &points);
  }
  return points;
}

void RunLayer::Draw(const MapFrame& frame, Svg* svg) const {
  const std::size_t points = Positions().size();
  const double tolerance = kTolerance * std::max(1.0, static_cast<double>(points) / kMostPoints);
  for (const RunRecord& run : earlier_) {
    DrawTrajectory(run.trajectory,
                   frame,
                   {.stroke = kEarlier, .stroke_width = 1.0, .opacity = 0.5},
                   tolerance,
                   svg);
  }
  for (std::size_t r = 0; r < runs_.size(); ++r) {
    const bool colored = r >= FirstColored(runs_);
    DrawTrajectory(
        runs_[r].trajectory,
        frame,
        {.stroke = colored ? palette::Cycle(palette::kRuns, r - FirstColored(runs_)) : kEarlier,
         .stroke_width = 1.4,
         .opacity = 0.7},
        tolerance,
        svg);
  }
}

void RunLayer::AddTo(Legend* legend) const {
  const std::size_t first = FirstColored(runs_);
  if (runs_.empty() && earlier_.empty()) return;
  legend->Heading("Runs");
  for (std::size_t r = first; r < runs_.size(); ++r) {
    const std::string name = Svg::Shortened(runs_[r].name, 12.0, 100.0);
    legend->Entry(LineSymbol(palette::Cycle(palette::kRuns, r - first)),
                  fmt::format("{} {}", name, FormatUtc(runs_[r].begin).substr(0, 16)));
  }
  if (first > 0) legend->Entry(LineSymbol(kEarlier), fmt::format("{} more of this version", first));
  if (!earlier_.empty()) {
    legend->Entry(LineSymbol(kEarlier), fmt::format("{} of earlier versions", earlier_.size()));
  }
}

}  // namespace shiftmap
