// SPDX-License-Identifier: Apache-2.0
#include "tools/plot/trajectory_plot.h"

#include <fmt/format.h>

#include <algorithm>

#include "mapstore/core/count_text.h"
#include "tools/eval/trajectory_error.h"
#include "tools/plot/chart_frame.h"
#include "tools/plot/landmark_layer.h"
#include "tools/plot/palette.h"
#include "tools/plot/run_layer.h"

namespace shiftmap {
namespace {

constexpr double kChartTop = 40.0;
constexpr double kChartHeight = 190.0;
constexpr double kChartBottom = 56.0;
constexpr double kMaxGapS = 1.0;    // Of the truth: TrajectoryErrorOptions::max_gap_s.
constexpr double kTolerance = 0.3;  // Of a drawn trajectory. [px]
constexpr double kBreakS = 10.0;    // A longer gap is no line.
constexpr const char* kTruthColor = palette::kInk;
constexpr const char* kTruthDash = "5 3";

const char* ColorOf(std::size_t estimate) { return palette::Cycle(palette::kRuns, estimate); }

// Times and position errors of one estimate.
struct ErrorLine {
  std::vector<Eigen::Vector2d> points;  // Seconds since the epoch, and metres.
  TrajectoryError error;
};

StatusOr<ErrorLine> ErrorOf(const NamedTrajectory& estimate, const NamedTrajectory& truth) {
  ErrorLine line;
  const StatusOr<TrajectoryError> error =
      EvaluateTrajectory(estimate.poses, truth.poses, {.max_gap_s = kMaxGapS});
  SHIFTMAP_RETURN_IF_ERROR(Annotate(error.status(), "trajectory '{}'", estimate.name));
  line.error = *error;
  for (const StampedPose& pose : estimate.poses) {
    const std::optional<Se2> T_map_truth =
        Interpolate(truth.poses, pose.stamp, FromSeconds(kMaxGapS));
    if (!T_map_truth) continue;
    line.points.emplace_back(
        ToSecondsSinceEpoch(pose.stamp),
        (pose.T_map_vehicle.translation() - T_map_truth->translation()).norm());
  }
  return line;
}

void DrawErrors(
    const std::vector<ErrorLine>& lines, double left, double top, double width, Svg* svg) {
  double first = lines.front().points.front().x();
  double last = first;
  double largest = 0.0;
  for (const ErrorLine& line : lines) {
    for (const Eigen::Vector2d& p : line.points) {
      first = std::min(first, p.x());
      last = std::max(last, p.x());
      largest = std::max(largest, p.y());
    }
  }
  ChartAxis x{.label = "time (UTC)",
              .scale = AxisScale::kTime,
              .pixel_min = left,
              .pixel_max = left + width};
  SetRange(first, last, &x);
  const ChartAxis y{.label = "position error [m]",
                    .min = 0.0,
                    .max = std::max(1e-3, 1.06 * largest),
                    .pixel_min = top + kChartTop + kChartHeight,
                    .pixel_max = top + kChartTop};
  DrawChartFrame(x, y, svg);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    const std::vector<Eigen::Vector2d>& points = lines[i].points;
    std::vector<Eigen::Vector2d> pixels;
    for (std::size_t k = 0; k < points.size(); ++k) {
      pixels.emplace_back(x.Pixel(points[k].x()), y.Pixel(points[k].y()));
      const bool ends = k + 1 == points.size() || points[k + 1].x() > points[k].x() + kBreakS;
      if (!ends) continue;
      if (pixels.size() > 1) {
        svg->Polyline(Condensed(pixels), {.stroke = ColorOf(i), .stroke_width = 1.3});
      }
      pixels.clear();
    }
  }
}

void AddEntry(const char* color, const std::string& dash, const std::string& text, Legend* legend) {
  legend->Entry(
      [color, dash](const Eigen::Vector2d& at, Svg* svg) {
        const Eigen::Vector2d half(10.0, 0.0);
        svg->Line(at - half, at + half, {.stroke = color, .stroke_width = 2.0, .dash = dash});
      },
      text);
}

// The legend's part on trajectories. With a truth, the errors against it are added to `errors`.
Status AddTrajectories(const std::vector<NamedTrajectory>& estimates,
                       const std::optional<NamedTrajectory>& truth,
                       std::vector<ErrorLine>* errors,
                       Legend* legend) {
  legend->Heading("Trajectories");
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    std::string text = Svg::Shortened(estimates[i].name, 12.0, 200.0);
    if (truth) {
      SHIFTMAP_ASSIGN_OR_RETURN(ErrorLine line, ErrorOf(estimates[i], *truth));
      text += fmt::format(": rmse {:.3f} m, median {:.3f} m, largest {:.3f} m",
                          line.error.position_rmse_m,
                          line.error.position_median_m,
                          line.error.position_max_m);
      errors->push_back(std::move(line));
    }
    AddEntry(ColorOf(i), "", text, legend);
  }
  if (truth) {
    AddEntry(kTruthColor, kTruthDash, "truth: " + Svg::Shortened(truth->name, 12.0, 160.0), legend);
  }
  return OkStatus();
}

void DrawTrajectories(const std::vector<NamedTrajectory>& estimates,
                      const std::optional<NamedTrajectory>& truth,
                      const MapFrame& frame,
                      Svg* svg) {
  if (truth) {
    DrawTrajectory(truth->poses,
                   frame,
                   {.stroke = kTruthColor, .stroke_width = 1.6, .dash = kTruthDash},
                   kTolerance,
                   svg);
  }
  for (std::size_t i = 0; i < estimates.size(); ++i) {
    DrawTrajectory(estimates[i].poses,
                   frame,
                   {.stroke = ColorOf(i), .stroke_width = 1.5, .opacity = 0.85},
                   kTolerance,
                   svg);
  }
}

}  // namespace

StatusOr<std::string> PlotTrajectories(const MapSnapshot& map,
                                       const std::vector<NamedTrajectory>& estimates,
                                       const std::optional<NamedTrajectory>& truth) {
  std::vector<ErrorLine> errors;
  Legend legend;
  SHIFTMAP_RETURN_IF_ERROR(AddTrajectories(estimates, truth, &errors, &legend));
  std::vector<Eigen::Vector2d> points;
  for (const NamedTrajectory& estimate : estimates) AppendPositions(estimate.poses, &points);
  if (truth) AppendPositions(truth->poses, &points);
  const LandmarkLayer landmarks(map.content(), std::move(points));
  landmarks.AddTo(&legend);
  const MapFrame& frame = landmarks.frame();
  Svg svg = StartMapPage(
      {.title = fmt::format("{} · version {} · trajectories", map.area(), map.version().value()),
       .subtitle = fmt::format("{} · trajectories: {}{}",
                               CountText(map.groups().size(), "landmark"),
                               estimates.size(),
                               truth ? ", and the truth" : ""),
       .below = errors.empty() ? 0.0 : kChartTop + kChartHeight + kChartBottom},
      frame,
      legend);
  landmarks.Draw(0.55, &svg);
  DrawTrajectories(estimates, truth, frame, &svg);
  if (!errors.empty()) {
    // As wide as the page, whatever the shape of the map.
    const double width = std::max(frame.size().x(), 480.0);
    DrawErrors(errors, frame.corner().x(), BelowMap(frame, legend), width, &svg);
  }
  return svg.ToString();
}

}  // namespace shiftmap
